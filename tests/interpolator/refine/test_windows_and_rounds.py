"""Windows whose counts stay on the device, and lists that are too short at first: the samples are the same."""

import numpy as np
import pytest
from refine_rig import refined, tumbling
from rigid_rig import lamp

import evis
from evis.gpu.cuda_graph import CudaGraphs
from evis.scene.model import Waveform
from nodes.interpolator.refine import rounds
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.refinement import Refinement
from nodes.interpolator.refine.rounds import Rounds
from nodes.interpolator.rigid import Rigid, RigidOptions


@pytest.fixture
def kept_on_device(monkeypatch):
    """Has a CPU do as a GPU does: no count is read before a window is done. Gives how often one was begun."""
    found, begun = Refinement._rounds_of, []

    def rounds_of(self, instants):
        made = found(self, instants)
        made.reads_counts = False
        begin = made._tally.begin
        made._tally.begin = lambda total: (begun.append(total), begin(total))
        return made

    monkeypatch.setattr(Refinement, "_rounds_of", rounds_of)
    return begun


def switched():
    return tumbling(lights=[lamp(waveform=Waveform("square", 700.0, 0.8, 0.1, 0.3))])


@pytest.mark.parametrize("at_first", [30.0, 0.001])
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("make", [tumbling, switched])
def test_counts_that_stay_on_the_device(make, threads, at_first, monkeypatch, request):
    """at_first: entries per pixel that lists have at first; with few they grow, and the window is done again."""
    scene = make()
    _, expected = refined(scene, 4, 50_000)
    begun = request.getfixturevalue("kept_on_device")
    monkeypatch.setattr(rounds, "AT_FIRST", at_first)
    _, found = refined(scene, 4, 50_000, threads=threads)
    for a, b in zip(expected, found):
        np.testing.assert_array_equal(a, b)
    assert (len(begun) == 1) == (at_first > 1)


def test_several_windows_of_which_each_grows(kept_on_device, monkeypatch):
    """Samples of the windows before stay."""
    scene = tumbling()
    monkeypatch.setattr("nodes.interpolator.refine.instants.ROWS", 1 << 17)
    monkeypatch.setattr(rounds, "AT_FIRST", 0.001)
    _, found = refined(scene, 4, 50_000)
    assert len(set(kept_on_device)) == 4 and len(kept_on_device) > 4
    monkeypatch.undo()
    _, expected = refined(scene, 4, 50_000)
    for a, b in zip(expected, found):
        np.testing.assert_array_equal(a, b)


def test_room_for_environments_that_have_no_gap_yet(kept_on_device, monkeypatch):
    """A quarter of what may come makes room for four times as much, and its samples stay as they are."""
    scene, run, found = tumbling(), Rounds.run, []
    _, expected = refined(scene, 4, 50_000)

    def of_a_quarter(self, window, total, meanwhile, share):
        assert share == 1.0
        made = run(self, window, total, meanwhile, 0.25)
        told = self._tally.read()
        found.append((made.samples, self.samples.size, int(told.lists[0].max()), self._requests.most))
        return made

    monkeypatch.setattr(Rounds, "run", of_a_quarter)
    _, samples = refined(scene, 4, 50_000)
    for a, b in zip(expected, samples):
        np.testing.assert_array_equal(a, b)
    made, room, listed, most = found[-1]
    assert made == len(expected[0]) > 1000
    assert room >= 4 * made and most >= 4 * listed


@pytest.mark.gpu
@pytest.mark.parametrize("scene", ["spinning_disk", "falling_objects"])
def test_recorded_launches_find_what_those_do_that_are_not(scene, monkeypatch):
    """Over so many gaps that graphs are recorded, and used again."""

    def samples():
        with evis.Simulation(
            scene, device="cuda", width=96, height=72, upsampling=4, time_tolerance=1e-4, outputs=["samples"]
        ) as simulation:
            made = [simulation.step().samples for _ in range(12)]
            return [each.numpy() for one in made for each in (one.first, one.offset, one.further)]

    recorded = samples()
    monkeypatch.setattr(CudaGraphs, "run", lambda self, key, launch: launch())
    for a, b in zip(recorded, samples()):
        np.testing.assert_array_equal(a, b)


def test_what_lies_by_instants_is_made_anew_where_gaps_are_divided_otherwise():
    """Three intervals of one instant and one of three have as many slots, but what is known of bodies does not fit."""
    scene = tumbling()
    rigid = Rigid(scene, scene.cameras[0], 1, 4, options=RigidOptions(single=True))
    refinement = Refinement(rigid, 50_000.0, 1, 16)
    for per_window, depth in ((3, 1), (1, 2), (3, 1)):
        made = refinement._rounds_of(Instants(4, depth, per_window))
        assert made.bends.shape[0] == 2 * per_window and made.bends.shape[2] == depth + 1
        assert refinement._rounds_of(Instants(4, depth, per_window)) is made
