"""Makes the demonstration (`python -m evis.demo`) and the gallery of scenes for the documentation."""
