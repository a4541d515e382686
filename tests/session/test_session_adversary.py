"""Nothing that a leader says gets the force over its ceiling: an enemy searches for it, with the telemetry in hand."""

from __future__ import annotations

import numpy as np
import pytest
from adversary import CEILING, HEADER, LENGTH, Attack, largest_force, search
from adversary_space import LENGTH as SPACE_LENGTH
from adversary_space import SpaceAttack, largest_force_in_space

from foretouch.robot import MATERIALS

THOUSANDS = 5000
HUNDREDS = 600
"""Programmes in space, whose ticks cost four times as much, and which last longer."""


@pytest.mark.long  # what was found is tried below
@pytest.mark.parametrize(
    ("material", "tries"),
    [("bone", 3), ("kelvin-voigt", 4), *(pytest.param(name, THOUSANDS, marks=pytest.mark.long) for name in MATERIALS)],
)
def test_a_search_finds_nothing(material: str, tries: int) -> None:
    result = search(lambda programme: largest_force(material, programme), tries, seed=5 if tries < THOUSANDS else 1)
    assert result.over == 0, result
    assert result.force > (5.0 if tries < THOUSANDS else 0.0), "it does press"


SOFT, HARD = ("kelvin-voigt", 1.1e-5, (-1.0, 0.0, 1.0)), ("bone", 6e-6, (1.0, -1.0))


@pytest.mark.long
@pytest.mark.parametrize(
    ("material", "dither", "pattern", "encoder"),
    [
        (*HARD, "flicker 15 um"),
        (*SOFT, "white 5 um"),
        *(pytest.param(*SOFT, kind, marks=pytest.mark.long) for kind in ("good", "flicker 10 um", "flicker 15 um")),
        *(pytest.param(*HARD, kind, marks=pytest.mark.long) for kind in ("good", "flicker 10 um", "white 5 um")),
    ],
)
def test_a_creep_that_trembles_proves_nothing(
    material: str, dither: float, pattern: tuple[float, ...], encoder: str
) -> None:
    programme = np.zeros(LENGTH)
    programme[2] = 0.99  # the drive is not clipped
    attack = Attack(material, programme)
    attack.encoder = encoder
    surface = attack.robot.surface
    for tick in range(700):
        attack.tick((surface - 3e-4) * max(tick - 300, 0) / 400)
    for _ in range(6):
        place, tick = surface - 3e-4, 0
        for _ in range(50):
            attack.tick(place)
        while not attack.telemetry.in_contact and tick < 6000:
            place, tick = place + 3e-7, tick + 1
            attack.tick(place + dither * pattern[tick % len(pattern)])
        for tick in range(60):
            attack.tick(place - 3e-3 * min(1.0, tick / 30))
    for _ in range(100):
        attack.tick(place - 4e-3)
    for _ in range(500):
        attack.tick(surface + 0.03)
    assert 4.0 < max(attack.forces) <= CEILING


def test_an_enemy_goes_on_after_a_stop() -> None:
    attack = Attack("bone", np.zeros(LENGTH))
    attack.step(attack.robot.surface + 0.003, 0.0, 0.0, 300)
    attack.stop(attack.robot.surface - 0.005, 0.0, 0.0, 300)
    before = len(attack.forces)
    attack.step(attack.robot.surface + 0.003, 0.0, 0.0, 1500)
    assert max(attack.forces[before:]) > 5.0


# --- in space ---------------------------------------------------------------------------------------------------------

IN_SPACE = [
    ("plane", "kelvin-voigt"),
    ("hill", "kelvin-voigt"),
    ("hill", "hunt-crossley"),
    ("phantom", "hunt-crossley"),
    ("phantom", "kelvin-voigt"),
]


@pytest.mark.parametrize(
    ("scene", "material", "tries"),
    [(*IN_SPACE[0], 1), *(pytest.param(*scene, HUNDREDS, marks=pytest.mark.long) for scene in IN_SPACE)],
)
def test_a_search_in_space_finds_nothing(scene: str, material: str, tries: int) -> None:
    result = search(lambda programme: largest_force_in_space(scene, material, programme), tries, SPACE_LENGTH)
    assert result.over == 0, result


@pytest.mark.long
def test_an_enemy_in_space_goes_on_after_a_stop() -> None:
    attack = SpaceAttack("plane", "kelvin-voigt", np.zeros(HEADER))
    deep = (0.0, 0.0, -0.05)
    while not attack.touches and len(attack.forces) < attack.longest_touch:
        attack.tick(deep)
    attack.step(deep, 1.0)
    before = len(attack.forces)
    attack.stop(deep, 0.0)
    assert max(attack.forces[:before]) > 10.0
    assert min(attack.forces[before:]) < 0.5, "the stop unloads"
    attack.step(deep, 1.0)
    assert 10.0 < max(attack.forces[before + 300 :]) <= CEILING, "and after it the same enemy presses again"


FOUND = {
    "beside the believed edge, where another normal is the true one": (
        "hill",
        (0.535, 0.831, 0.3, 0.706, 0.835),
        (0.85, 0.392, 0.17, 0.385, 0.93),
    ),
    "beside it again": ("hill", (0.1549, 0.6323, 0.2029, 0.6122, 0.9612), (0.85, 0.1349, 0.4394, 0.7632, 0.1504)),
    "and again": ("hill", (0.1117, 0.3013, 0.1432, 0.3855, 0.7868), (0.85, 0.831, 0.5, 0.048, 0.742)),
    "along a plane that is inclined otherwise, where it swung up to 27 N": (
        "plane",
        (0.34326, 0.94072, 0.49908, 0.70998, 0.8302),
        (0.89763, 0.26911, 0.68852, 0.74096, 0.38258),
        (0.45831, 0.63018, 0.31441, 0.15195, 0.06922),
        (0.79141, 0.70252, 0.08573, 0.04498, 0.74372),
        (0.59332, 0.55936, 0.76706, 0.76397, 0.47594),
        (0.81173, 0.85939, 0.30283, 0.09684, 0.08824),
    ),
    "under the fixture and over its edge, where it pressed with 17 N": (
        "hill",
        (0.3361, 0.676, 0.4858, 0.9968, 0.4411),
        (0.6421, 0.8028, 0.2169, 0.7883, 0.6232),
        (0.9533, 0.016, 0.3516, 0.8924, 0.7657),
        (0.8527, 0.248, 0.025, 0.7625, 0.503),
    ),
    "beside the fixture's edge and then over it, where air was proven beside it, into 33 N": (
        "hill",
        (0.27592, 0.5321, 0.56602, 0.06583, 0.25563),
        (0.87636, 0.01219, 0.23715, 0.27487, 0.67481),
        (0.89363, 0.32537, 0.13256, 0.07193, 0.76734),
        (0.94889, 0.29482, 0.76607, 0.93253, 0.4908),
        (0.31437, 0.61667, 0.10908, 0.58579, 0.00151),
    ),
    "out of a first touch sideways, up an incline, where the force passed the ceiling by 0.2 N": (
        "hill",
        (0.62009, 0.15696, 0.47179, 0.64621, 0.17653),
        (0.96414, 0.84895, 0.60549, 0.39883, 0.29856),
    ),
    "back to a far course that gave way, whose displacement counted as the probe's motion, into 25 N": (
        "phantom",
        (0.67087, 0.98901, 0.16345, 0.56553, 0.85336),
        (0.68042, 0.31944, 0.12889, 0.0627, 0.27482),
        (0.59136, 0.91082, 0.26867, 0.14582, 0.94962),
        (0.36619, 0.77409, 0.99236, 0.28123, 0.5478),
        (0.82066, 0.13814, 0.06467, 0.63833, 0.59399),
        (0.90658, 0.65827, 0.90697, 0.52212, 0.6262),
    ),
    "the same on a plane, into 65 N": (
        "plane",
        (0.16873, 0.4129, 0.80545, 0.33618, 0.42016),
        (0.89756, 0.22146, 0.50312, 0.59418, 0.88473),
        (0.6342, 0.65363, 0.31576, 0.76119, 0.76425),
        (0.20118, 0.99559, 0.84504, 0.65945, 0.01456),
        (0.13309, 0.98024, 0.99952, 0.04177, 0.89406),
        (0.01915, 0.37027, 0.67177, 0.39592, 0.28913),
    ),
}
"""Ways that a search has found: a scene, the first numbers of a programme, and its parts."""


@pytest.mark.parametrize(
    ("scene", "header", "parts"),
    [
        pytest.param(scene, header, parts, id=way, marks=[] if "beside the believed" in way else pytest.mark.long)
        for way, (scene, header, *parts) in FOUND.items()
    ],
)
@pytest.mark.long
def test_what_a_search_has_found_presses_no_harder_any_more(scene: str, header: tuple, parts: list[tuple]) -> None:
    attack = SpaceAttack(scene, "kelvin-voigt", np.array(header))
    for genes in parts:
        attack.act(np.array(genes))
    assert (2.0 if scene == "plane" else 4.0) < max(attack.forces) <= CEILING
