"""Joins the messages that several devices publish of their shares of the environments."""
