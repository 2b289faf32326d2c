"""Makes images that surfaces and skies are made of: read from files or made by code, in linear light."""
