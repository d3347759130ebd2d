"""How many examples a run draws: YASPS_HYPOTHESIS_PROFILE is "ci" (default), "nightly", or "mutation".

"mutation" is for tests/mutations: ci's examples, not shrunk. The profiles are registered with
hypothesis but not loaded: other folders' tests keep their own settings.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, Phase, settings

PROFILE = os.environ.get("YASPS_HYPOTHESIS_PROFILE", "ci")
NAMES = ("ci", "nightly", "mutation")
IS_NIGHTLY = PROFILE == "nightly"
_SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]


def register() -> None:
    """Makes the profiles known; raises ValueError if the variable names another one."""
    common = settings(deadline=None, report_multiple_bugs=False, suppress_health_check=_SLOW)
    settings.register_profile("ci", common, derandomize=True, database=None)
    settings.register_profile("nightly", common, print_blob=True)
    settings.register_profile("mutation", settings.get_profile("ci"), phases=(Phase.generate,))
    if PROFILE not in NAMES:
        raise ValueError(f"YASPS_HYPOTHESIS_PROFILE is {PROFILE!r}; it must be one of {', '.join(NAMES)}")


def examples(ci: int, nightly: int) -> settings:
    """Settings of one test: the current profile with this many examples."""
    register()
    counts = {"ci": ci, "nightly": nightly, "mutation": ci}
    return settings(settings.get_profile(PROFILE), max_examples=counts[PROFILE])
