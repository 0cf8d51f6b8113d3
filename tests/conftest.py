"""Real data where it is there, a scene, and settings for all tests.

Two cores of an Intel Xeon of 2.1 GHz (Sapphire Rapids) take 5 minutes, another 5 for those that
are marked slow, and 20 for those that are marked long, too.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from assets.source.data_folder import DATA
from poseviewer.cli.terminal import tell_of_compiling
from poseviewer.render.software.compiled import compile_kernels
from tests.scene import Scene, make_scene

# The same examples every time, however busy the machine: a failure can be run again, and a green
# run stays green.
settings.register_profile("seeded", derandomize=True, deadline=None)
settings.load_profile("seeded")

# Workers inherit this: BLAS threads of several processes on the same cores only hinder
# each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Kernels are compiled once, not by each of the processes that run tests."""
    if not hasattr(session.config, "workerinput") and not session.config.option.collectonly:
        tell_of_compiling()
        compile_kernels()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first: short ones then fill up what is left of the time."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A state folder that is not that of whoever runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("POSEVIEWER_STATE", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real photos, models and poses; skips where it is absent."""
    if not (DATA / "cases.json").is_file():
        pytest.skip(f"no real data in {DATA}; set POSEVIEWER_DATA to the folder that has it")
    return DATA


@pytest.fixture(scope="session")
def shared_cases() -> Path:
    """The folder of small files that were read wrong once; skips where it is absent."""
    folder = Path(os.environ.get("POSEVIEWER_CASES") or DATA.parent / "cases")
    if not (folder / "camera_forms").is_dir():
        pytest.skip(f"no cases in {folder}; set POSEVIEWER_CASES to the folder that has them")
    return folder


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """A small photo, its model, the true pose and a start, as files."""
    return make_scene(tmp_path_factory.mktemp("scene"))
