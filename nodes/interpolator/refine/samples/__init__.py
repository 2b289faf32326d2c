"""Holds the lists of requests and samples: they grow and are counted on the device, and the sensor gets them in order.

`request_kernels.py` describes the list of requests, `list_kernels.py` the part of a list that a band of rows has, and
the samples. On the host `lists.py` makes room for them and `tally.py` counts them, where kernels read the counts too,
so that a GPU goes from one list to the next without the host. `sort_kernels.py` sorts samples by pixel and time; where
pixels are means of several sub-pixels, `means.py` merges theirs by `mean_kernels.py`.
"""
