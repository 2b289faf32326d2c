"""Contacts of flexes: who touches is the flex's own body, not a geom that happens to be the model's last."""

import numpy as np
import pytest

from evis.scene import load_scene
from nodes.physics.engines.mujoco_engine import MujocoEngine
from nodes.physics.interval import Extras

MODEL = """<mujoco><option timestep="0.001" integrator="discrete"/><worldbody>
<body name="table"><joint name="rail" type="slide" axis="1 0 0" damping="100"/><geom name="table" type="box"
size=".5 .5 {thin}" mass="50"/></body>
<flexcomp name="soft" type="grid" dim="3" count="3 3 3" spacing=".1 .1 .1" pos="0 0 {high}" mass="1" radius=".01"
dof="{dof}"><contact selfcollide="none"/><elasticity young="2e4" poisson=".1" damping=".005"/></flexcomp>
<body name="far" pos="3 0 .5"><joint type="slide" axis="0 1 0"/><geom name="far" size=".1"/></body>
</worldbody></mujoco>"""


def engine_of(tmp_path, **values):
    (tmp_path / "m.xml").write_text(MODEL.format(**({"thin": 0.05, "high": 0.16, "dof": "full"} | values)))
    return MujocoEngine(load_scene(str(tmp_path / "m.xml"), visuals=False), extras=Extras(contacts=True))


@pytest.mark.parametrize("dof", ["full", "trilinear"])
def test_a_contact_of_a_flex_has_the_body_beside_it(tmp_path, dof):
    """The table's body and the lowest body of the flex in that corner, whatever else has geoms."""
    engine = engine_of(tmp_path, dof=dof)
    contacts = engine.advance(100_000_000).contacts
    names = [engine.model.body(i).name for i in range(1, engine.model.nbody)]
    assert len(contacts.body) >= 4
    place = engine.data[0].xpos[1:]
    for (one, other), at in zip(contacts.body, contacts.position):
        assert names[one] == "table" and names[other].startswith("soft")
        others = [k for k, name in enumerate(names) if name.startswith("soft")]
        least = min(np.linalg.norm(place[k] - at) for k in others)
        assert np.linalg.norm(place[other] - at) < least + 0.01  # the state is a step older than the contacts
    assert np.isclose(contacts.force[:, 2].sum(), 9.81, rtol=0.5)


def test_a_flex_that_goes_deep_is_called_by_its_name(tmp_path):
    """A block of soft matter that is half within a thin plate from the start."""
    engine = engine_of(tmp_path, thin=0.002, high=0.1)
    said = [text for _, text in engine.advance(50_000_000).warnings]
    assert any("geom 'table' and flex 'soft' overlap" in text for text in said), said
    assert not any("'far'" in text for text in said)
