"""Computes labels of what each pixel shows, out of depth and ids of one stamp.

`flow_field.py` computes flow and `image_labels.py` boxes, both by `image_label_kernels.py`. `instance_tables.py` looks
up what the camera's info tells of the instances in an image, and `box_groups.py` chooses which of them have boxes.
"""
