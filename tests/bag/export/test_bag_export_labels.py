"""Labels from a bag to archives, read back against the messages; and which formats a topic has."""

import dataclasses

import numpy as np
import pytest
from bag_files import KEYFRAMES, bag, run
from bag_messages import scene

from evis.bag import BagError
from evis.bag.export.topics import export
from evis.bag.writer import BagWriter


def labelled(k, envs=1, **left_out):
    """Labels of the k-th keyframe with 0 to 3 boxes and contacts in each environment."""
    whole = scene(k, envs)["/cam0/labels"]
    rng = np.random.default_rng([9, k])
    env = np.repeat(np.arange(envs), [(k + e) % 4 for e in range(envs)]).astype(np.int32)
    n = len(env)
    more = {
        "depth": rng.normal(size=(envs, 5, 7)).astype(np.float32),
        "velocity": rng.normal(size=(envs, 4, 6)),
        "box": rng.normal(size=(n, 4)).astype(np.float32),
        "box_env": env,
        "box_id": rng.integers(0, 9, n).astype(np.int32),
        "contact_env": env,
        "contact_body": rng.integers(-1, 4, (n, 2)).astype(np.int32),
        "contact_position": rng.normal(size=(n, 3)),
        "contact_force": rng.normal(size=(n, 3)),
        "names": ["cam0", "a", "link/ä", "b"],
    }
    return dataclasses.replace(whole, **{**more, **left_out})


def label_bag(path, messages):
    with BagWriter(path) as writer:
        for message in messages:
            writer.write("/cam0/labels", message)
    return path


@pytest.mark.parametrize(("envs", "topic", "env"), [(1, "/cam0/labels", 0), (3, "/env2/cam0/labels", 2)])
def test_labels_to_npz(tmp_path, envs, topic, env):
    """Every kind of label, as many rows in each message as there were; read back against the messages."""
    sent = [labelled(k, envs) for k in range(KEYFRAMES)]
    path = label_bag(tmp_path / "a.mcap", sent)
    result = export(path, topic, tmp_path / "l.npz")
    with np.load(tmp_path / "l.npz", allow_pickle=False) as got:
        assert sorted(got) == sorted(result["arrays"]) and result["messages"] == KEYFRAMES
        assert {n: list(got[n].shape) for n in got} == result["arrays"]
        assert got["t"].tolist() == [m.header.stamp_ns for m in sent] and got["t"].dtype == np.int64
        assert got["names"].tolist() == ["cam0", "a", "link/ä", "b"] and got["episode"].tolist() == [0] * KEYFRAMES
        for name in ("flow", "depth", "segmentation", "pose", "velocity"):
            want = np.stack([getattr(m, name)[env] for m in sent])
            assert got[name].dtype == want.dtype and got[name].tobytes() == want.tobytes()
        for kind in ("box", "contact"):
            fields = ("box", "box_id") if kind == "box" else ("contact_body", "contact_position", "contact_force")
            for k, m in enumerate(sent):
                mine = getattr(m, f"{kind}_env") == env
                part = slice(*got[f"{kind}_offsets"][k : k + 2])
                assert mine.sum() == (k + env) % 4
                assert (got[f"{kind}_t"][part] == m.header.stamp_ns).all()
                for field in fields:
                    assert got[field][part].tobytes() == getattr(m, field)[mine].tobytes()
        assert "semantic" not in got and not any(n.endswith("_env") for n in got)


def test_labels_that_no_archive_holds(tmp_path):
    """One line that says why, and the way out works."""
    path = label_bag(tmp_path / "a.mcap", [labelled(0, 2)])
    with pytest.raises(BagError, match=r"several environments; name one of them: /env0/cam0/labels"):
        export(path, "/cam0/labels", tmp_path / "l.npz")
    path = label_bag(tmp_path / "b.mcap", [labelled(0), labelled(1, flow=None), labelled(2)])
    with pytest.raises(BagError, match=r"flow is in 2 of 3 messages; export to \.jsonl"):
        export(path, "/cam0/labels", tmp_path / "l.npz")
    assert not (tmp_path / "l.npz").exists()
    assert export(path, "/cam0/labels", tmp_path / "l.jsonl")["messages"] == 3
    contacts = ("contact_env", "contact_body", "contact_position", "contact_force")
    boxes_only = dict.fromkeys(("flow", "depth", "segmentation", "pose", "velocity", *contacts))
    empty = label_bag(tmp_path / "c.mcap", [labelled(k, **boxes_only) for k in (0, 4)])
    export(empty, "/cam0/labels", tmp_path / "e.npz")
    with np.load(tmp_path / "e.npz") as got:
        assert got["box"].shape == (0, 4) and got["box_offsets"].tolist() == [0, 0, 0]


def test_an_error_names_the_formats_that_the_topic_has(tmp_path):
    path = label_bag(tmp_path / "a.mcap", [labelled(0)])
    bag(tmp_path / "b.mcap")
    for source, topic, out, text in (
        (path, "/cam0/labels", "l.csv", "(Labels) to {}: name it .npz or .jsonl"),
        (path, "/cam0/labels", "l.png", "(Labels) to {}: name it .npz or .jsonl"),
        (
            tmp_path / "b.mcap",
            "/cam0/image",
            "i.jpg",
            "(Image) to {}: name it .npz or .jsonl, or a folder for PNG files",
        ),
        (
            tmp_path / "b.mcap",
            "/cam0/keyframe",
            "k.raw",
            "(Keyframe) to {}: name it .npz or .jsonl, or a folder for EXR",
        ),
        (tmp_path / "b.mcap", "/cam0/events", "e.png", ".csv, .txt, .raw"),
    ):
        status, out_text, err = run("bag", "export", str(source), "--topic", topic, str(tmp_path / out))
        assert status == 2 and out_text == "" and err.count("\n") == 1
        assert text.format(tmp_path / out) in err and ("raw" in err) == (topic == "/cam0/events" or "k.raw" in out)
    with pytest.raises(BagError, match=r"no extension; name it l\.npz \(there are \.npz, \.jsonl\)"):
        export(tmp_path / "b.mcap", "/cam0/imu", tmp_path / "l")
