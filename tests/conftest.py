"""What every test runs under: shapes checked at run time, one thread, no network, real recordings if present."""

import os
import socket
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# How long an example takes says how busy the machine is, and nothing of the code.
settings.register_profile("any-machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any-machine")

SOURCE = Path(__file__).parents[1] / "src"


def checked_modules() -> list[str]:
    """Modules whose annotations are checked at each call: all but packages and numba's kernels.

    The hook matches by prefix, so packages, which hold nothing of their own, must not be named. Kernels are compiled
    and cannot be wrapped.
    """
    names = [".".join(path.relative_to(SOURCE).with_suffix("").parts) for path in sorted(SOURCE.rglob("*.py"))]
    return [name for name in names if not name.endswith(("__init__", "__main__", "_kernels"))]


def _check_shapes() -> None:
    from jaxtyping import install_import_hook

    loaded = sorted(name for name in sys.modules if name.startswith("poseloom."))
    if loaded:
        raise RuntimeError(f"shapes cannot be checked, for these modules are already imported: {', '.join(loaded)}")
    install_import_hook(checked_modules(), "beartype.beartype")


_check_shapes()


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings; skips where they are not unpacked."""
    default = Path.home() / ".cache" / "poseloom-recordings"
    folder = Path(os.environ.get("POSELOOM_DATA", default))
    if not (folder / "mocap").is_dir():
        pytest.skip(f"no real recordings in {folder} (set POSELOOM_DATA to the folder that holds mocap/, imu/, flex/)")
    return folder


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--network", action="store_true", default=False, help="Let tests reach hosts other than this machine."
    )


@pytest.fixture(autouse=True, scope="session")
def only_this_machine(request: pytest.FixtureRequest):
    """Refuses connections to other hosts."""
    if request.config.getoption("--network"):
        yield
        return
    connect = socket.socket.connect

    def connect_here(self: socket.socket, address: object) -> None:
        host = address[0] if isinstance(address, tuple) else ""
        if self.family != socket.AF_UNIX and host not in ("localhost", "::1") and not str(host).startswith("127."):
            raise PermissionError(f"a test tried to reach {host}")
        connect(self, address)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket.socket, "connect", connect_here)
        yield
