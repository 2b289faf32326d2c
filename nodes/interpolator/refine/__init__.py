"""Takes further samples of single pixels between the frames of a gap, where what a pixel shows changes
(`time_tolerance`).

The words of this room:

- A gap between keyframes A and B has K *coarse intervals*; the frames of `rigid` stand at their ends (coarse frames).
- A coarse interval is divided by 2^depth - 1 *instants* inside it. They alone are candidates for samples, and those of
  a *window* of neighbouring coarse intervals are placed together, one per *slot*.
- *Probes* are z-buffers without any light at some of the instants; they tell which surfaces a pixel shows in between.
- A *transition* is the instant at which a pixel passes from one surface to another; between two of them is a *run* of
  one surface.
- A *request* asks for the radiance of a pixel at an instant; a *sample* is what it was found to be.

The way of the data:

1. `method.py` is the method; `refinement.py` takes a gap and cuts it into windows; `rounds.py` goes through the steps
   below for a window, with the kernels that `specialisation.py` makes for the scene. `window_kernels.py` holds what all
   of them read, `frame_kernels.py` the frames of a window.
2. Instants: `instants.py` chooses the candidates, and `probing/` draws as many probes as what moves asks for.
3. Requests: in `runs/` for pixels that show one surface, and for every run of those that show several. They follow a
   pixel over a surface by `paths/`, and ask `light/` when lamps and shadows change.
4. Radiance: `evaluation/` finds what a pixel sees at the instant of a request, and its radiance there.
5. Intervals: `halving/` makes samples of requests, and halves intervals between them in which ln I is not straight;
   their middles are evaluated next (4), until none is left.
6. Samples: `samples/` holds all lists, sorts the samples by pixel and time for the sensor, and averages those of
   sub-pixels.
"""
