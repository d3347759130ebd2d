"""How many examples a run draws: YASPS_HYPOTHESIS_PROFILE is "ci" (default) or "nightly".

The profiles are registered with hypothesis but not loaded: other folders' tests keep their own settings.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

PROFILE = os.environ.get("YASPS_HYPOTHESIS_PROFILE", "ci")
IS_NIGHTLY = PROFILE == "nightly"
_SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]


def register() -> None:
    """Makes both profiles known; raises ValueError if the variable names another one."""
    common = settings(deadline=None, report_multiple_bugs=False, suppress_health_check=_SLOW)
    settings.register_profile("ci", common, derandomize=True, database=None)
    settings.register_profile("nightly", common, print_blob=True)
    if PROFILE not in ("ci", "nightly"):
        raise ValueError(f"YASPS_HYPOTHESIS_PROFILE is {PROFILE!r}; it must be ci or nightly")


def examples(ci: int, nightly: int) -> settings:
    """Settings of one test: the current profile with this many examples."""
    register()
    return settings(settings.get_profile(PROFILE), max_examples=nightly if IS_NIGHTLY else ci)
