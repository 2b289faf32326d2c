"""Takes further samples of single pixels between the frames of a gap, where what a pixel shows changes
(`time_tolerance`).

The words of this room:

- A gap between keyframes A and B has K *coarse intervals*; the frames of `rigid` stand at their ends (coarse frames).
- A coarse interval is divided by 2^depth - 1 *instants* inside it. They alone are candidates for samples, and those of
  a *window* of neighbouring coarse intervals are placed together, one per *slot*.
- *Probes* are z-buffers without any light at some of the instants; they tell which surfaces a pixel shows in between.
- A *change* is the instant at which a pixel passes from one surface to another; between two changes is a *run* of one
  surface.
- A *sample* is the radiance I of one pixel at one instant.

The path of the data, file by file:

1. `refinement.py` takes a gap and cuts it into windows; `rounds.py` goes through the steps below for a window.
   `window_kernels.py` holds what all kernels of a window read.
2. Which instants: `instants.py` chooses the candidates, and `probing/` draws as many probes as what moves asks for.
3. Which pixels: in `runs/`, `single_surface_kernels.py` lists the samples of pixels that show one surface,
   `transition_kernels.py` and `transition_time_kernels.py` find the changes of all others, and `run_kernels.py` lists
   the samples that each of their runs needs. Both follow a pixel over a surface by `paths/`: in a keyframe, past probes
   between which bodies go straight, or on what is painted there where no keyframe shows it. `light/` lists those that
   lamps and shadows ask for.
4. Evaluation: in `evaluation/`, `visibility_kernels.py` finds what a pixel sees at an instant, and `evaluator.py`
   computes its radiance. `halving/` halves intervals that are still not straight, whose middles are evaluated next.
5. Lists for the sensor: in `samples/`, `sort_kernels.py` sorts all samples by pixel and time. Where pixels are means
   of several, all this is done for each of these sub-pixels, and `means.py` merges what is found. What is listed lies
   in `lists.py` and is counted in `tally.py`, where the kernels that go through a list read its length: so a GPU goes
   from one to the next without the host.
"""
