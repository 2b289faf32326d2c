"""Lists the tasks that come with EVIS, by name."""

from collections.abc import Callable

from evis.env.task import Task
from evis.env.tasks.cart_pole import CartPole
from evis.env.tasks.pan_tilt import PanTilt
from evis.env.tasks.pong import Pong

TASKS: dict[str, Callable[[], Task]] = {"CartPole": CartPole, "PanTilt": PanTilt, "Pong": Pong}
