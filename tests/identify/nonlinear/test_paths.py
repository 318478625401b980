"""Paths and tangents as machine code, which is stored as long as it is current."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from identify.model.exponentials import low_pass_of
from identify.nonlinear import kernels as compiled
from identify.nonlinear import path as paths
from identify.nonlinear.car import MOUNT, RATIO, Car, car
from identify.nonlinear.fit import scatter, widened
from identify.nonlinear.path import (
    PATH,
    POLISH,
    Channels,
    InitialState,
    damper_curve,
    filtered,
    first_columns,
    path_of,
)
from identify.nonlinear.path import Path as Motion

from .truth import BASELINE, model_of, moving, rich

END_S = 0.2
STEP = 1e-6

CORNERS = PATH._replace(load_n=60.0)
"""A tyre that meets the road within 20 N does so between two nodes of the tangents."""


STEP_S = 2.5e-3 / 8


def path_along(one: Car, own: InitialState) -> Motion:
    path = path_of(one, own, END_S, STEP_S, CORNERS)
    assert path is not None
    return path


def motion(one: Car, own: InitialState, times: np.ndarray) -> np.ndarray:
    seen = paths.sample(one, path_along(one, own), times)
    return np.concatenate([seen.motion(k) for k in range(3)], axis=1)


@pytest.mark.parametrize("mounted", [False, True])
def test_tangents_are_the_differences_of_paths(mounted: bool) -> None:
    model = model_of()
    eta = rich(model, mounted)
    names = model.names
    free = np.array([i for i, n in enumerate(names) if mounted or not n.startswith("s_m")])
    one, own = car(model, eta, BASELINE, free), moving()
    times = np.asarray(
        2.0 * STEP_S * np.arange(5, 305, 8)
    )  # at nodes: between two, a corner is cut
    everything = Channels(times, np.repeat([0, 1, 2], 7), np.tile(np.eye(7), (3, 1)))
    grade = POLISH._replace(path=CORNERS, coarse=CORNERS, fine=CORNERS)
    (found,) = paths.tangents(one, path_along(one, own), own, grade, [everything])
    n_own = found.shape[2] - len(free)
    for column in (0, 4, 9, 12, 15):
        step = np.zeros(n_own)
        step[column] = STEP
        number = (motion(one, own.moved(step), times) - motion(one, own.moved(-step), times)) / (
            2 * STEP
        )
        check(found[:, :, column], number)
    for name in (
        "m_s", "I_xx", "k_tf", "c_sf", "a", "t_f", "F_cf", "d_cr", "r_cf", "v_cf", "h_f2", "k_bf",
        "p_bf", "y_s",
    ):  # fmt: skip
        k = names.index(name)
        high, low = eta.copy(), eta.copy()
        high[k] += STEP
        low[k] -= STEP
        number = (
            motion(car(model, high, BASELINE, free), own, times)
            - motion(car(model, low, BASELINE, free), own, times)
        ) / (2 * STEP)
        # Static friction acts for a few milliseconds, some steps of the tangents.
        most = 0.08 if name in ("r_cf", "v_cf") else 0.02
        check(found[:, :, n_own + np.flatnonzero(free == k)[0]], number, most)


@pytest.mark.parametrize(("lag_s", "finite"), [(PATH.lag_s, True), (0.4 * PATH.lag_s, False)])
def test_bare_coulomb_friction_stays_stable_at_high_speed(lag_s: float, finite: bool) -> None:
    """Friction that builds up over 0.01 mm, at 3 m/s: the lag bounds how fast it turns."""
    model = model_of()
    eta, own = rich(model, False), moving()
    eta[[model.names.index(name) for name in ("d_cf", "d_cr")]] = np.log(0.01e-3)
    one = car(model, eta, BASELINE, np.zeros(0, dtype=np.intp))
    motion = own.motion.copy()
    motion[7:] *= 3.0 / np.abs(one.travel_speeds(motion)).max()
    own, step_s = replace(own, motion=motion), paths.step_of([one], POLISH)
    assert (path_of(one, own, END_S, step_s, PATH._replace(lag_s=lag_s)) is not None) is finite


def test_the_mounts_give_at_first_by_the_force_of_their_dampers() -> None:
    """Compliance times damper force over the ratio, of a car whose dampers differ by 10 %."""
    model = model_of()
    eta, free, own = rich(model, True), np.arange(len(model.names)), moving()

    def deflected(at: np.ndarray) -> np.ndarray:
        one = car(model, at, BASELINE, free)
        force, _ = damper_curve(one, one.travel_speeds(own.motion), PATH.knee_m_s)
        return np.asarray(one.corner[:, MOUNT] * one.corner[:, RATIO] * force)

    found = first_columns(car(model, eta, BASELINE, free), own, PATH)[18:, 22:]
    for column, k in enumerate(free.tolist()):
        step = STEP * np.eye(len(eta))[k]
        number = (deflected(eta + step) - deflected(eta - step)) / (2 * STEP)
        np.testing.assert_allclose(
            found[:, column], number, rtol=1e-5, atol=1e-12, err_msg=model.names[k]
        )


def check(tangent: np.ndarray, number: np.ndarray, most: float = 0.02) -> None:
    # The laws have corners: at a finite step a few samples see the other side of one.
    for order in range(3):
        part = slice(7 * order, 7 * order + 7)
        error = np.linalg.norm(tangent[:, part] - number[:, part])
        assert error < most * np.linalg.norm(number[:, part])


def scores(times_s: list[float], sizes: list[float]) -> Any:
    """Return one run with the scores of two unknowns: of so much, and of twice as much.

    Beside them each sample shows the run's own unknown, whose share is taken off: its slope is 3,
    and through it go 1 / 2 of the first unknown and none of the second.
    """
    n = len(times_s)
    left = np.array(sizes)[:, None]
    jacobian = np.empty((n, 1, 3))
    jacobian[:, 0] = [3.0, 1.0 + 3.0 / 2.0, 2.0]
    recording = SimpleNamespace(time_s=np.array(times_s))
    run = SimpleNamespace(end_s=1.0, decay=SimpleNamespace(recordings=(recording,)))
    problem = SimpleNamespace(free=np.arange(2), runs=(run,))
    block = SimpleNamespace(A=np.array([[4.0]]), B=np.array([[2.0, 0.0]]), jacobian=(jacobian,))
    return SimpleNamespace(
        problem=problem,
        predicted=(SimpleNamespace(residuals=(left,)),),
        normal=SimpleNamespace(blocks=(block,)),
    )


@pytest.mark.parametrize(
    ("times_s", "sizes", "expected"),
    [
        ([0.001], [5.0], 25.0),
        ([0.001, 0.004], [5.0, 2.0], 49.0),  # within 5 ms they add up
        ([0.001, 0.006], [5.0, 2.0], 29.0 + 2 * 10.0 * (1 - 1 / 41)),
        ([0.001, 0.106], [5.0, 2.0], 29.0 + 2 * 10.0 * (1 - 21 / 41)),
        ([0.001, 0.201], [5.0, 2.0], 29.0 + 2 * 10.0 * (1 - 40 / 41)),
        ([0.001, 0.207], [5.0, 2.0], 29.0),  # 0.2 s apart they are independent
        ([0.001, 0.051, 0.101], [1.0, -1.0, 1.0], 3.0 - 4 * (1 - 10 / 41) + 2 * (1 - 20 / 41)),
    ],
)
def test_what_is_left_within_a_fifth_of_a_second_scatters_together(
    times_s: list[float], sizes: list[float], expected: float
) -> None:
    at = scores(times_s, sizes)
    assert scatter(at) == pytest.approx(expected * np.array([[1.0, 2.0], [2.0, 4.0]]))


def test_deviations_are_raised_to_the_scatter_and_never_lowered() -> None:
    """C S C has 16 and 0.5 on its diagonal, of 4 and 1: deviations of 2 and 1 become 4 and 1."""
    covariance = np.array([[4.0, 0.6], [0.6, 1.0]])
    found = widened(np.diag([4.0, 1.0]), np.diag([1.0, 0.5]))
    assert found == pytest.approx(np.diag([16.0, 1.0]))
    both = widened(covariance, np.linalg.inv(covariance))
    assert both == pytest.approx(covariance)
    four = widened(covariance, 4.0 * np.linalg.inv(covariance))
    assert four == pytest.approx(4.0 * covariance)  # correlations stay


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_sensor_that_was_at_rest_filters_a_path_as_scipy_does(order: int) -> None:
    """Two columns at once; a fine simulation beside steps of 2 ms."""
    channel = Channel(
        "a", Quantity.BODY_ACCELERATION, "m/s2", low_pass_hz=20.0, low_pass_order=order
    )

    def motion(t: NDArray[np.floating]) -> NDArray[np.float64]:
        wave = np.exp(-3.0 * t) * np.sin(2 * np.pi * 9.0 * t)
        return np.column_stack([wave, np.cos(2 * np.pi * 1.3 * t) - 1.0])

    from scipy import signal  # a second to import, in every process that collects

    fine = np.arange(5001) * 1e-4
    system = signal.butter(order, 2.0 * np.pi * 20.0, analog=True)
    expected = np.column_stack([signal.lsim(system, u, fine)[1] for u in motion(fine).T])
    times = np.array([0.0, 0.0123, 0.1, 0.2501, 0.4999, 0.5])
    found = filtered(low_pass_of(channel), motion(np.arange(251) * 2e-3), 2e-3, times)
    assert found == pytest.approx(expected[np.rint(times * 1e4).astype(int)], abs=2e-4)


ROOT = Path(__file__).parents[3]

_FORCE = """
import numpy as np
from identify.nonlinear import kernels

line, knots = np.array([0.0, 1000.0, 500.0]), np.array([0.1])
force = kernels.curve(line, knots, 0.1, 0.02)
print(force, sum(kernels.curve.stats.cache_hits.values()), sep=chr(10))
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Return a folder with the packages, whose sources can be changed."""
    shutil.copytree(ROOT / "identify", tmp_path / "identify", ignore=lambda *_: ["__pycache__"])
    for name in ("daq", "dbc"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def force_of(copy: Path, before: str = "") -> tuple[float, bool]:
    """Return the force of a damper in the middle of a knee, and whether its code was stored.

    `before`: runs in the same process before.
    """
    kept = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}  # Python's own looks at times alone
    command = [sys.executable, "-c", before + _FORCE]
    done = subprocess.run(command, cwd=copy, env=kept, check=True, capture_output=True)
    force, hits = done.stdout.split()
    return round(float(force), 9), hits == b"1"


def test_a_changed_formula_in_another_file_changes_what_a_kernel_returns(copy: Path) -> None:
    """The kernel takes the rounded knee, (width / 4) in its middle, from the elements."""
    assert force_of(copy) == (100.0 + 500.0 * 0.02 / 4.0, False)
    assert force_of(copy) == (102.5, True)

    hinge = copy / "identify" / "nonlinear" / "laws.py"
    sharper = hinge.read_text("utf-8").replace("inside / (4.0 * width)", "inside / (8.0 * width)")
    hinge.write_text(sharper, "utf-8")
    assert force_of(copy) == (101.25, False)


_NOWHERE = """
import numba.core.caching

def read_only(self): raise OSError("read-only file system")

numba.core.caching._CacheLocator.ensure_cache_path = read_only
"""


def test_where_no_folder_can_be_written_it_is_compiled_anew(copy: Path) -> None:
    assert force_of(copy, _NOWHERE) == (102.5, False)
    folder = copy / "identify" / "nonlinear" / "__pycache__"
    assert not list(folder.glob("kernels.curve_*.nb[ic]"))


def test_all_that_a_kernel_takes_in_counts() -> None:
    """Kernels take the laws and constants that the car's file states; laws take nothing."""
    room = ROOT / "identify" / "nonlinear"
    ours = re.compile(r"^from (\.\S*|daq\S*|dbc\S*|identify\S*) import (.+)$", re.MULTILINE)
    assert ours.findall((room / "kernels.py").read_text("utf-8")) == [(".", "car, laws")]
    assert ours.findall((room / "laws.py").read_text("utf-8")) == []
    assert {path.name for path in compiled.SOURCES} == {"car.py", "kernels.py", "laws.py"}
    texts = {path.name: path.read_text("utf-8") for path in room.glob("*.py")}
    assert [name for name, text in texts.items() if re.search("@kernel|@njit", text)] == [
        "kernels.py"
    ]
