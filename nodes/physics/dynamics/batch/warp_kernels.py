"""Works between the steps of MuJoCo Warp: it holds worlds that have taken all steps, and records the states.

Arrays are of E worlds; `count` [E] are the steps that each is to take, `step` [1] the number of the present one.
"""

import warp as wp

HUGE = wp.constant(1.0e10)
"""A position or velocity beyond this is of a world that has diverged, as MuJoCo has it (mjMAXVAL)."""


@wp.func
def sound(values: wp.array(dtype=float), number: int):
    good = bool(True)
    for i in range(number):
        if not (wp.abs(values[i]) < HUGE):
            good = False
    return good


@wp.func
def copy(source: wp.array(dtype=float), target: wp.array(dtype=float), number: int):
    for i in range(number):
        target[i] = source[i]


@wp.kernel(enable_backward=False)
def settle(
    step: wp.array(dtype=int),
    constraints: wp.array(dtype=int),
    count: wp.array(dtype=int),
    diverged: wp.array(dtype=int),
    constrained: wp.array(dtype=int),
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    act: wp.array2d(dtype=float),
    warmstart: wp.array2d(dtype=float),
    kept_qpos: wp.array2d(dtype=float),
    kept_qvel: wp.array2d(dtype=float),
    kept_act: wp.array2d(dtype=float),
    kept_warmstart: wp.array2d(dtype=float),
):
    """Keeps the state of a world that was to take this step, and puts the others back to the one kept last.

    A world whose state is not finite any more takes no further steps.
    """
    world = wp.tid()
    nq, nv, na = qpos.shape[1], qvel.shape[1], act.shape[1]
    if step[0] < count[world]:
        if sound(qpos[world], nq) and sound(qvel[world], nv):
            constrained[world] = constraints[world]
            copy(qpos[world], kept_qpos[world], nq)
            copy(qvel[world], kept_qvel[world], nv)
            copy(act[world], kept_act[world], na)
            copy(warmstart[world], kept_warmstart[world], nv)
            return
        diverged[world] = 1
        count[world] = 0
    copy(kept_qpos[world], qpos[world], nq)
    copy(kept_qvel[world], qvel[world], nv)
    copy(kept_act[world], act[world], na)
    copy(kept_warmstart[world], warmstart[world], nv)


@wp.kernel(enable_backward=False)
def record(
    step: wp.array(dtype=int),
    root: wp.array(dtype=int),
    xpos: wp.array2d(dtype=wp.vec3),
    xquat: wp.array2d(dtype=wp.quat),
    cvel: wp.array2d(dtype=wp.spatial_vector),
    centre: wp.array2d(dtype=wp.vec3),
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    pose: wp.array4d(dtype=float),
    twist: wp.array4d(dtype=float),
    all_qpos: wp.array3d(dtype=float),
    all_qvel: wp.array3d(dtype=float),
):
    """Writes poses and twists of the bodies without the world, and the joints, after this step: [E, S, ...].

    root: the body at the top of each body's tree, about whose centre of mass MuJoCo has the velocities.
    """
    world, body = wp.tid()
    s = step[0]
    place, turn = xpos[world, body + 1], xquat[world, body + 1]
    omega, v = wp.spatial_top(cvel[world, body + 1]), wp.spatial_bottom(cvel[world, body + 1])
    v = v + wp.cross(omega, place - centre[world, root[body + 1]])
    for k in range(3):
        pose[world, s, body, k] = place[k]
        twist[world, s, body, k] = v[k]
        twist[world, s, body, 3 + k] = omega[k]
    # MuJoCo's quaternions are w x y z, also where Warp counts them x y z w.
    for k in range(4):
        pose[world, s, body, 3 + k] = turn[(k + 1) % 4]
    if body == 0:
        for k in range(qpos.shape[1]):
            all_qpos[world, s, k] = qpos[world, k]
        for k in range(qvel.shape[1]):
            all_qvel[world, s, k] = qvel[world, k]


@wp.kernel(enable_backward=False)
def deepest(
    contacts: wp.array(dtype=int),
    world: wp.array(dtype=int),
    distance: wp.array(dtype=float),
    nearest: wp.array(dtype=float),
):
    """Notes the least distance of each world's contacts."""
    contact = wp.tid()
    if contact < contacts[0]:
        wp.atomic_min(nearest, world[contact], distance[contact])


@wp.kernel(enable_backward=False)
def go_on(step: wp.array(dtype=int)):
    """Adds one to the number of the step."""
    step[0] = step[0] + 1
