"""A tap on a latched topic: its last value arrives, however soon it follows another."""

import time

import numpy as np
import zmq

from evis.bus import Publisher, Subscriber, endpoints_for
from msgs.camera import CameraInfo
from msgs.header import Header

TOPIC = "/cam0/info"


def info(n):
    return CameraInfo(
        Header(n), k=np.eye(3), distortion=np.zeros(0), distortion_model="none", name="cam0", width=4, height=3,
        margin=0, envs=1, keyframe_rate=30.0,
    )  # fmt: skip


def test_the_last_of_several_values_in_a_row_arrives(tmp_path):
    context = zmq.Context()
    tmp_path.chmod(0o700)
    where = endpoints_for(tmp_path, TOPIC)
    publisher = Publisher(context, TOPIC, "renderer", where, [], message_type=CameraInfo, latched=True)
    tap = Subscriber(context, TOPIC, "labeler", "info", where, message_type=CameraInfo, tap=True)
    try:
        publisher.start()
        tap.start()
        found = []

        def pump(until):
            deadline = time.monotonic() + 20
            while not until() and time.monotonic() < deadline:
                publisher.pump()
                if (message := tap.receive(1)) is not None:
                    found.append(message.header.stamp_ns)

        pump(publisher.tapped)
        for n in range(1, 6):
            publisher.send(info(n))
        pump(lambda: found[-1:] == [5])
        assert found[-1:] == [5]
    finally:
        tap.close()
        publisher.close()
        context.destroy(linger=0)
