"""What frames are too slow for, against what sampling theory says and what samples of the thing itself show."""

from dataclasses import replace

import numpy as np
import pytest

from evis.geometry import se3
from evis.scene import load_scene
from evis.scene.model import Body, Light, Scene, Waveform
from evis.scene.motion import Prescribed, Sinusoid, Spin, Swing
from evis.scene.sampling import Turns, undersampled

REST = se3.make_pose(np.zeros(3), np.array([0, 0, 0, 1.0]))
Z = np.array([0, 0, 1.0])


def scene(*motions, flicker=None):
    light = Light("sun", "directional", np.ones(3), Z, waveform=flicker)
    return Scene("case", [Body("rotor", Prescribed(REST, motions))], [], [], [light], [], np.zeros(3))


def seen_frequency(phases):
    """Of e^(i phase) in equal steps: |turns| per step, as it looks, in -1/2 ... 1/2."""
    step = np.angle(np.exp(1j * np.diff(phases)))
    return np.abs(step).mean() / (2 * np.pi)


@pytest.mark.parametrize("rate", [1.0, 59.0, 119.0, 121.0, 239.0, 240.0, 10_000.0])
def test_a_turn_is_named_when_frames_show_another_rate(rate):
    """At 240 frames per second: just where the angle that frames by themselves show is not the angle turned."""
    phases = 2 * np.pi * rate * np.arange(100) / 240
    false = not np.isclose(seen_frequency(phases) * 240, rate)
    lines = undersampled(scene(Spin(Z, 2 * np.pi * rate)), 240)
    assert len(lines) == false
    assert all(f"body 'rotor' makes {rate:.4g} turns" in line and "frames come at 240 Hz" in line for line in lines)


def kept(wave, frame_rate):
    """Share of the change of ln I that samples show, the least over the phases, of a hundred periods."""
    times = np.arange(int(100 * frame_rate / wave.frequency)) / frame_rate
    shares = []
    for phase in np.linspace(0, 1, 16, endpoint=False):
        at = (wave.frequency * times + phase) % 1
        if wave.kind == "sine":
            strength, low, high = 1 + wave.depth * np.sin(2 * np.pi * at), 1 - wave.depth, 1 + wave.depth
        else:
            low, high = 1 - wave.depth, 1 + wave.depth * (1 - wave.duty) / wave.duty
            strength = np.where(at < wave.duty, high, low)
        whole = 2 * 100 * np.log(high / low)
        shares.append(np.abs(np.diff(np.log(strength))).sum() / whole)
    return min(shares)


@pytest.mark.parametrize("wave", [
    Waveform("sine", 100, 0.3), Waveform("sine", 240, 0.9), Waveform("square", 240, 0.8, duty=0.2),
    Waveform("square", 100, 0.5, duty=0.95), Waveform("square", 100, 0.5, duty=0.5),
])  # fmt: skip
@pytest.mark.parametrize("per_period", [0.5, 1, 1.3, 2, 2.4, 4.1, 4.8, 6.3, 8, 10.3, 16.5, 40.2, 81])
def test_flicker_is_named_where_frames_miss_a_part_of_it(wave, per_period):
    """What is not named keeps nine tenths of its change at any phase, and four fifths where it is nearly dark once."""
    frame_rate = per_period * wave.frequency
    lines, share = undersampled(scene(flicker=wave), frame_rate), kept(wave, frame_rate)
    assert len(lines) == 1 or share > (0.9 if wave.depth <= 0.5 else 0.8)
    for line in lines:
        assert f"light 'sun' flickers at {wave.frequency:g} Hz and frames come at {frame_rate:g} Hz" in line
        assert ("something slower" in line) == (per_period <= 2)
        wanted = float(line.split("; ")[1].split(" Hz")[0])
        assert wanted > frame_rate and undersampled(scene(flicker=wave), wanted * 1.001) == []


@pytest.mark.parametrize(("frequency", "pixel_rate", "named"), [
    (240, 0.0, True), (240, 625.0, False), (240, 100.0, True), (1920, 5000.0, False), (1930, 5000.0, True),
])  # fmt: skip
def test_a_light_that_single_pixels_follow_is_not_named(frequency, pixel_rate, named):
    """At 30 keyframes per second 64 periods of 1920 Hz are in a gap; what is faster goes by the frames, at 120 Hz."""
    lines = undersampled(scene(flicker=Waveform("square", frequency, 0.8, duty=0.2)), 120, pixel_rate, 30)
    assert len(lines) == named
    assert all("frames come at 120 Hz" in line for line in lines)


@pytest.mark.parametrize(("duty", "named"), [(1e-4, False), (1 - 1e-4, False), (1e-5, True), (1 - 1e-5, True)])
def test_a_flash_shorter_than_any_instants_is_named(duty, named):
    """At 240 frames per second 1024 instants between two are 4 us apart: a flash of 10 us has two, one of 1 us none."""
    assert len(undersampled(scene(flicker=Waveform("square", 10, 1.0, duty=duty)), 240, 5000.0, 30)) == named


def test_a_turn_is_held_against_single_pixels_too():
    turning = scene(Spin(Z, 2 * np.pi * 300))
    assert undersampled(turning, 240) and not undersampled(turning, 240, 1000.0, 30)


@pytest.mark.parametrize(("keyframe_rate", "named"), [(0.46, True), (0.466, False)])
def test_between_keyframes_too_far_apart_pixels_go_by_frames(keyframe_rate, named):
    """A sample's int32 of ns since a keyframe ends at 2.147 s, 0.4657 keyframes a second."""
    lines = undersampled(scene(Spin(Z, 15.0)), 4 * keyframe_rate, 500.0, keyframe_rate)
    assert len(lines) == named
    assert all("frames come at 1.84 Hz" in line for line in lines)


def test_a_light_that_does_not_vary_is_not_named():
    assert undersampled(scene(flicker=Waveform("sine", 240, 0.0)), 240) == []


def test_what_swings_counts_by_its_frequency_and_by_its_rate():
    assert undersampled(scene(Sinusoid(Z, 119.0)), 240) == []
    assert len(undersampled(scene(Sinusoid(Z, 121.0)), 240)) == 1
    assert undersampled(scene(Sinusoid(0 * Z, 121.0)), 240) == []
    assert len(undersampled(scene(Swing(Z, 1e-3, 121.0)), 240)) == 1
    # 100 rad to and fro ten times a second is up to 1000 turns per second.
    assert len(undersampled(scene(Swing(Z, 100.0, 10.0)), 240)) == 1
    assert undersampled(scene(Swing(Z, 1.0, 10.0)), 240) == []


@pytest.mark.parametrize("name", ["spinning_disk", "fidget_spinner", "drone", "tunnel_exit", "falling_objects"])
def test_the_shipped_scenes_are_slow_enough_for_the_default_frames(name):
    assert undersampled(load_scene(name, textures=False), 240) == []


def test_what_an_engine_turns_is_noticed_once_and_what_is_prescribed_is_not():
    """Half about in a frame of 240 Hz is 240 pi rad/s, in any of its sub-steps."""
    world = scene(Spin(Z, 1.0))
    free = Body("free", None)
    turns = Turns(replace(world, bodies=[*world.bodies, free]), 240.0)
    free_body = len(world.bodies)
    moving = np.array([0, free_body])
    twist = np.zeros((2, 5, 2, 6))
    twist[:, :, 0, 5] = 1e4
    twist[1, 3, 1, 4] = 0.99 * 240 * np.pi
    assert turns.too_fast(moving, twist) == []
    twist[1, 3, 1, 4] = 1.01 * 240 * np.pi
    (line,) = turns.too_fast(moving, twist)
    assert "body 'free' makes 121.2 turns per second" in line and "969.6 Hz would do" in line
    assert turns.too_fast(moving, twist) == []
    assert Turns(world, 0.0).too_fast(moving[:1], twist[:, :, :1]) == []


def test_of_environments_the_fastest_is_named():
    """Their lamps are drawn: the line is that of the fastest, and says which environment has it; one of a world that
    all have says nothing of environments."""
    waves = [Waveform("sine", frequency, 0.5) for frequency in (10.0, 50.0, 70.0, 20.0)]
    scenes = [scene(flicker=wave) for wave in waves]
    (line,) = undersampled(scenes, 240)
    assert line == undersampled(scenes[2], 240)[0].replace("Hz and", "Hz in environment 2 and")
    assert undersampled([scenes[2]] * 3, 240) == undersampled(scenes[2], 240)
    assert undersampled(scenes[::3], 240) == []


def test_a_lamp_that_another_environment_has_drawn_is_told_before_the_start(tmp_path):
    """The seed draws one of two frequencies; the first environment's is slow enough."""
    from nodes.renderer.node import RendererNode

    path = tmp_path / "s.yaml"
    flicker = "flicker: {kind: sine, frequency: {choose: [5, 500]}, depth: 0.5}"
    path.write_text(
        f"cameras: {{cam0: {{fov: 1}}}}\nlights: {{lamp: {{kind: directional, direction: [0, 0, 1], irradiance: 1, "
        f"{flicker}}}}}\n"
    )
    drawn = [load_scene(str(path), seed=seed).lights[0].waveform.frequency for seed in range(20)]
    first = next(seed for seed in range(19) if drawn[seed] == 5 and drawn[seed + 1] == 500)
    defaults = {name: param.default for name, param in RendererNode.PARAMS.items()}
    params = defaults | {"scene": str(path), "seed": first, "frame_rate": 240.0}
    assert RendererNode.foreseen(params) == ()
    (line,) = RendererNode.foreseen(params | {"envs": 2})
    assert "light 'lamp' flickers at 500 Hz in environment 1" in line


def test_many_that_are_alike_are_one_line_with_the_remedy_for_all():
    """A hall of 200 lamps on one mains, one of them on a faster one, and two fans: 202 lines were printed."""
    lamps = [
        Light(f"lamp{i}", "directional", np.ones(3), Z, waveform=Waveform("sine", 110 if i == 7 else 100, 0.3))
        for i in range(200)
    ]
    fans = [Body(f"fan{i}", Prescribed(REST, (Spin(Z, 2 * np.pi * (300 + i)),))) for i in range(2)]
    hall = replace(scene(), lights=lamps, bodies=fans)
    of_lamps, of_fans = undersampled(hall, 240)
    assert "light 'lamp7' flickers at 110 Hz" in of_lamps and "; 880 Hz would do" in of_lamps
    assert of_lamps.endswith(", for 199 other lights too: 'lamp0', 'lamp1', 'lamp2', ...")
    assert of_fans.startswith("body 'fan1' ") and of_fans.endswith(", for 1 other body too: 'fan0'")
    assert all("light" not in line for line in undersampled(hall, 880))

    free = [Body(f"free{i}", None) for i in range(50)]
    turns = Turns(replace(scene(), bodies=free), 240.0)
    (line,) = turns.too_fast(np.arange(50), np.full((1, 2, 50, 6), 1e4))
    assert line.startswith("body 'free0' ") and ", for 49 other bodies too: 'free1', " in line
