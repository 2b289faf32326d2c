"""Shares the environments or the cameras of a graph among several devices (`device:=cuda:0,cuda:1`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from evis.config.document import LaunchError
from evis.launch import catalog
from evis.launch.arguments import ArgumentError
from evis.launch.expand import NodeSpec
from evis.launch.graph.wiring import WiredNode
from evis.shares.bounds import MOST, bounds
from evis.shares.cut import can_be_cut
from msgs.topics import SYSTEM_TOPICS, find_topic

SHARE, JOIN = "environment_share", "environment_join"
"""Types of the nodes that cut messages into shares of the environments, and that join them again."""


def devices_of(params: Mapping[str, Any]) -> list[str]:
    """Lists the devices that a node's parameters name: `cuda:0,cuda:1` are two."""
    return [word.strip() for word in str(params.get("device") or "").split(",")]


def named_in_share(name: str, share: int) -> str:
    """Gives the name of the copy of node `name` that works on one share of the environments."""
    return f"share{share}/{name}"


def over_devices(nodes: list[WiredNode]) -> list[WiredNode]:
    """Returns the nodes of a graph in which nodes with several devices are replaced by one node per device.

    Where there are as many environments as devices, each device works on a share of the environments; otherwise each
    camera's nodes run on one device. Nodes that need all environments at once, such as the audit, run on the first
    device. A graph whose nodes name one device each is returned as it is.

    Raises ArgumentError for more devices than environments and cameras, LaunchError for nodes whose devices or numbers
    of environments differ.
    """
    several = [node for node in nodes if len(devices_of(node.params)) > 1]
    if not several:
        return nodes
    devices, where = devices_of(several[0].params), several[-1].spec.where
    given = ",".join(devices)
    if any(devices_of(node.params) != devices for node in several):
        raise LaunchError(f"{where}: '{several[-1].name}' has other devices than '{several[0].name}', {given}")
    if not all(devices):
        raise ArgumentError(f"device:={given} lacks a name beside a comma; several devices are named as cuda:0,cuda:1")
    if len(devices) > MOST:
        raise ArgumentError(f"device:={given} names {len(devices)} devices, the most is {MOST}")
    counts = {int(node.params["envs"]) for node in several if "envs" in node.params}
    if len(counts) > 1:
        raise LaunchError(f"{where}: nodes on several devices have {' and '.join(map(str, sorted(counts)))} envs")
    envs = max(counts, default=1)
    cameras = list(dict.fromkeys(str(node.params["camera"]) for node in several if "camera" in node.params))
    if envs >= len(devices):
        return _by_environments(nodes, devices, envs)
    if len(cameras) >= len(devices):
        return _by_cameras(nodes, devices, cameras)
    there = f"{envs} environment{'s' * (envs != 1)} and {len(cameras)} camera{'s' * (len(cameras) != 1)}"
    raise ArgumentError(
        f"device:={given} names {len(devices)} devices for {there}: each device takes one environment or one camera "
        f"at least; name fewer, or give more, as envs:={len(devices)}"
    )


def _by_cameras(nodes: list[WiredNode], devices: Sequence[str], cameras: Sequence[str]) -> list[WiredNode]:
    """Puts each camera's nodes on one device, those of a device in one process."""
    of = {cameras[c]: k for k, own in enumerate(bounds(len(cameras), len(devices))) for c in range(len(cameras))[own]}
    made = []
    for node in nodes:
        share = of.get(str(node.params.get("camera")), 0)
        if len(devices_of(node.params)) == 1:
            made.append(node)
            continue
        group = f"share{share}"
        params = {**node.params, "device": devices[share]}
        made.append(replace(node, params=params, spec=replace(node.spec, process=group), group=group))
    return made


def _by_environments(nodes: list[WiredNode], devices: Sequence[str], envs: int) -> list[WiredNode]:
    """Copies nodes for each share of the environments, in a process per share, with nodes that share and join."""
    split = [node for node in nodes if len(devices_of(node.params)) > 1 and node.cls.PER_ENVIRONMENT]
    inner = {topic: node for node in split for topic in node.outputs.values() if topic not in SYSTEM_TOPICS}
    # What a sensor reads of an interpolator that is left out, nobody makes.
    made_here = {topic for node in nodes for topic in node.outputs.values()} - {*inner, *SYSTEM_TOPICS}
    outer = {topic: node for node in split for topic in node.inputs.values() if topic in made_here}
    made = [node if node in split else _on_first(node, devices) for node in nodes]
    shares = bounds(envs, len(devices))
    parts = [_share(topic, node, k, len(devices)) for topic, node in outer.items() for k in range(len(devices))]
    parts += [_part(node, k, devices[k], own) for node in split for k, own in enumerate(shares)]
    joins = [_join(topic, node, envs, len(devices)) for topic, node in inner.items()]
    first = next((i for i, node in enumerate(made) if node in split), len(made))
    return [*made[:first], *parts, *joins, *(node for node in made[first:] if node not in split)]


def _on_first(node: WiredNode, devices: Sequence[str]) -> WiredNode:
    """Puts a node with several devices on the first one."""
    if len(devices_of(node.params)) == 1:
        return node
    return replace(node, params={**node.params, "device": devices[0]})


def _part(node: WiredNode, share: int, device: str, envs: slice) -> WiredNode:
    """Copies a node for one share; its environments keep the seeds that they have among all."""
    group = f"share{share}"
    params = {**node.params, "device": device}
    if "envs" in params:
        params["envs"] = envs.stop - envs.start
    if "seed" in params:
        params["seed"] = int(params["seed"] or 0) + envs.start
    own = {port: _below(group, topic) for port, topic in node.inputs.items()}
    spec = replace(node.spec, name=named_in_share(node.name, share), process=group)
    outputs = {port: _below(group, topic) for port, topic in node.outputs.items()}
    return replace(node, spec=spec, params=params, inputs=own, outputs=outputs, group=group, part=True)


def _share(topic: str, reader: WiredNode, share: int, shares: int) -> WiredNode:
    """Makes the node that cuts one share out of the messages of a topic."""
    kind, where = find_topic(topic).type, reader.spec.where
    if not can_be_cut(kind):
        raise LaunchError(f"{where}: '{reader.name}' reads {topic}, which is not dealt out to devices; name one device")
    params = {"topic": topic.strip("/"), "share": share, "shares": shares}
    target, cls = catalog.load(SHARE, where)
    group = f"share{share}"
    spec = NodeSpec(f"{group}{topic}", SHARE, where, params, process=group)
    outputs = {"part": _below(group, topic)}
    return WiredNode(spec, target, cls, params, {"whole": topic}, outputs, group=group, part=True)


def _join(topic: str, publisher: WiredNode, envs: int, shares: int) -> WiredNode:
    """Makes the node that joins the messages of all shares on a topic."""
    params = {"topic": topic.strip("/"), "shares": shares, "envs": envs}
    where = publisher.spec.where
    target, cls = catalog.load(JOIN, where)
    late = publisher.spec.on_demand
    keep = ["whole"] if late and publisher.spec.keep else []
    spec = NodeSpec(f"join{topic}", JOIN, where, params, process="join", on_demand=late, keep=keep)
    inputs = {f"share{k}": _below(f"share{k}", topic) for k in range(shares)}
    is_open = all(publisher.late_output(port) for port, name in publisher.outputs.items() if name == topic)
    return WiredNode(spec, target, cls, params, inputs, {"whole": topic}, joins=True, open=is_open)


def _below(group: str, topic: str) -> str:
    """Gives the topic of a share, such as /share0/cam0/events; system topics are shared by all."""
    return topic if topic in SYSTEM_TOPICS else f"/{group}{topic}"
