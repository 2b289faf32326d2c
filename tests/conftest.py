"""What holds for all tests: the same examples in every run, and no example is late on a loaded machine.

`pytest --hypothesis-profile explore` looks for new examples.
"""

from hypothesis import HealthCheck, settings

PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", PATIENT, derandomize=True)
settings.register_profile("explore", PATIENT)
settings.load_profile("same")
