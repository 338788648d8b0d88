"""Property tests draw the same examples on every machine, however slow it is; Ctrl-C is heard in the background too."""

import gc
import signal
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

SOLVED = ("tests/runs/test_ready_scenes", "tests/runs/test_effects_off")  # files of the fixture `solved`

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # by nohup, or by a shell's `&`: programs started here inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("repeatable")


def pytest_collection_finish() -> None:
    """Tests and libraries stay to the end: the many collections of garbage need not look through them."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Each file on one worker, which prepares once what its tests share; so are files of the same scenes."""
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file, *_ = nodeid.split("::")
            return "solved" if file.startswith(SOLVED) else file

    return ByFile(config, log)
