"""Files that are read and written safely: whole or not at all, within an allowance, with errors that name them."""
