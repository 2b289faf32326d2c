"""Makes the kernels of a window with code only for what there is in the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from nodes.interpolator.refine.evaluation.evaluator import changes_of
from nodes.interpolator.refine.evaluation.limb_kernels import make_shade_limbs
from nodes.interpolator.refine.evaluation.trace_kernels import trace_pixels
from nodes.interpolator.refine.halving.check_kernels import make_check
from nodes.interpolator.refine.halving.split_kernels import make_split
from nodes.interpolator.refine.paths.texture_charts import follows_textures
from nodes.interpolator.refine.runs.run_kernels import make_request_run_ends, make_request_runs
from nodes.interpolator.refine.runs.single_surface_kernels import make_request_single_surface
from nodes.interpolator.refine.runs.transition_kernels import find_changed_spans, make_find_transitions
from nodes.interpolator.refine.runs.transition_time_kernels import make_find_transition_times
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.rigid.reprojection import textured_in

TRANSITION_BLOCK = 64
"""Threads of a block that finds transitions: it ends with the slowest of these."""


@dataclass(frozen=True)
class Kernels:
    """Holds the kernels of a window that depend on the scene."""

    request_single_surface: wp.Kernel
    find_transition_times: wp.Kernel
    request_run_ends: wp.Kernel
    request_runs: wp.Kernel
    check: wp.Kernel
    split: wp.Kernel
    shade_limbs: wp.Kernel | None

    @classmethod
    def of(cls, rigid: Rigid) -> Kernels:
        """Makes the kernels for what there is in the scene of a `Rigid`."""
        layout, lens, changes = rigid.layout, rigid.visibility.lens, changes_of(rigid)
        features = rigid.shading.features
        painted = features.textures or features.vertex_colours
        v = rigid.visibility
        textured = textured_in(rigid.shading, layout) and follows_textures(v.scene, v.geometry, v.camera_body)
        how = (lens, layout.channels, layout.waveform_count, layout.relight, painted, textured, changes)
        # Without normals of its own nothing is round; light that comes evenly from all sides is the same at a limb.
        limbs = features.smooth and (features.lit or features.sky_map or features.gloss)
        alone = replace(features, cached=False, shadow_pass=False, grids=False, tiled=False, half=False)
        return cls(
            make_request_single_surface(*how),
            make_find_transition_times(limbs),
            make_request_run_ends(layout.channels, not layout.flicker, limbs),
            make_request_runs(*how),
            make_check(layout.channels, changes.view),
            make_split(layout.channels),
            make_shade_limbs(layout.channels, alone) if limbs else None,
        )

    def to_build(self, trees: bool) -> list[tuple[wp.Kernel, int]]:
        """Lists the kernels and their block sizes for `build_together`. trees: as of `make_trace_all`."""
        changing = (
            self.request_single_surface,
            find_changed_spans,
            self.find_transition_times,
            self.request_run_ends,
            self.request_runs,
            self.check,
            self.split,
            trace_pixels,
            *([self.shade_limbs] if self.shade_limbs else []),
        )
        return [*((kernel, LAUNCH_BLOCK) for kernel in changing), (make_find_transitions(trees), TRANSITION_BLOCK)]
