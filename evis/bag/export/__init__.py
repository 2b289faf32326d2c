"""Single topics out of a bag as files of their own."""
