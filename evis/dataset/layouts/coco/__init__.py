"""Writes and reads COCO: images, boxes and masks, with the events beside them."""
