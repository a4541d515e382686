"""Units, signs and scales of a map, and what is guessed from names in several languages."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import RecordingError
from foretouch.recordings import Mapping, Signal, TimeSource, Velocity, read_mapping, read_recording, write_mapping
from foretouch.recordings.meaning.mapping import FORCES, LENGTHS, NEEDS_SCALE, TIMES, mapping_text, parse_mapping
from foretouch.recordings.meaning.names import FORCE, POSITION, TIME, name_says, rank

FACTORS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "rad": 1.0, "deg": math.pi / 180, "raw": 1.0}
FORCE_FACTORS = {"N": 1.0, "mN": 1e-3, "cN": 1e-2, "kN": 1e3, "Nm": 1.0, "raw": 1.0}
scales = st.floats(1e-3, 1e3).filter(lambda scale: scale != 1.0)
texts = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=12)


def signal_of(units):
    return st.builds(
        Signal, column=texts, unit=st.sampled_from(sorted(units)), sign=st.sampled_from([1, -1]), scale=scales
    )


mappings = st.builds(
    Mapping,
    position=signal_of(LENGTHS),
    force=signal_of(FORCES),
    time=st.builds(TimeSource, column=texts, unit=st.sampled_from(sorted(TIMES))),
    velocity=st.none() | st.builds(Velocity, column=texts),
    join=st.sampled_from(["interpolate", "hold"]),
    contact_floor=st.floats(0.0, 10.0),
)


@given(mappings)
def test_a_map_reads_back_as_it_was_written(mapping):
    assert parse_mapping("map", mapping_text(mapping)) == mapping


@given(
    unit=st.sampled_from(sorted(LENGTHS)),
    force_unit=st.sampled_from(sorted(FORCES)),
    time_unit=st.sampled_from(sorted(TIMES)),
    sign=st.sampled_from([1, -1]),
    force_sign=st.sampled_from([1, -1]),
    scale=scales,
    positions=st.lists(st.floats(-1e-4, 1e-4), min_size=2, max_size=8),
)
def test_units_signs_and_scales_against_their_definition(
    tmp_path_factory, unit, force_unit, time_unit, sign, force_sign, scale, positions
):
    folder = tmp_path_factory.mktemp("units")
    rows = "".join(f"{tick},{x!r},{1e3 * x!r},{2 * x!r}\n" for tick, x in enumerate(positions))
    (folder / "t.csv").write_text("t,x,f,v\n" + rows)
    mapping = Mapping(
        Signal(column="x", unit=unit, sign=sign, scale=scale),
        Signal(column="f", unit=force_unit, sign=force_sign, scale=scale),
        TimeSource(column="t", unit=time_unit),
        Velocity(column="v"),
    )
    write_mapping(folder / "map.toml", mapping)
    got = read_recording(folder / "t.csv", map_file=folder / "map.toml")
    x = np.array(positions)
    np.testing.assert_allclose(got.position, sign * scale * FACTORS[unit] * x, rtol=1e-14, atol=1e-300)
    np.testing.assert_allclose(got.velocity, sign * scale * FACTORS[unit] * 2 * x, rtol=1e-14, atol=1e-300)
    np.testing.assert_allclose(
        got.force, force_sign * scale * FORCE_FACTORS[force_unit] * 1e3 * x, rtol=1e-14, atol=1e-300
    )
    seconds = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}[time_unit]
    np.testing.assert_allclose(got.time, seconds * np.arange(x.size), rtol=1e-15)


GOOD = '[time]\ncolumn="t"\n[position]\ncolumn="x"\nunit="mm"\n[force]\ncolumn="f"\nunit="N"\n'


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('unit="mm"', "", r"\[position\] unit is not said: give one of m, cm, mm, um, rad, deg, raw"),
        ('unit="mm"', 'unit="inch"', r"\[position\] unit 'inch' is not known"),
        ('unit="N"', 'unit="kg"', r"\[force\] unit 'kg' is not known: give one of N, mN, cN, kN, Nm, raw"),
        ('unit="mm"', 'unit="rad"', r"\[position\] is in rad and needs scale = metres for a radian"),
        ('unit="N"', 'unit="Nm"', r"\[force\] is in Nm and needs scale = newtons for a newton metre"),
        ('unit="mm"', 'unit="mm"\nsign=2', r"is no map:.*sign"),
        ('unit="mm"', 'unit="mm"\nscale=0.0', r"scale = 0: must be finite and above 0"),
        ('unit="mm"', 'unit="mm"\nlength=1', r"is no map:.*length"),
        ('column="x"', 'column="x"\ntopic="/x"', r"\[position\] takes either column, or topic and field"),
        ('column="x"', 'topic="/x"', r"\[position\] takes either column, or topic and field"),
        ('column="x"', 'topic="/x"\nfield="y"', r"both a column, or both a topic"),
        ('column="t"', 'column="t"\nunit="day"', r"\[time\] unit 'day' is not known: give one of s, ms, us, ns, min"),
        ('column="t"', "rate=-1.0", r"rate = -1"),
        ('column="t"', 'stamp="gps"', r"is no map:.*gps"),
        ("[force]", "[power]", r"is no map:.*it takes \[time\], \[position\] and \[force\]"),
        ("[time]", "[time", r"is no map"),
        ("[time]", 'join = "best"\n[time]', r"is no map:.*best"),
    ],
)
def test_a_map_that_is_none_is_refused_in_one_line(tmp_path, old, new, problem):
    path = tmp_path / "map.toml"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(RecordingError) as caught:
        read_mapping(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert re.search(problem, str(caught.value)), str(caught.value)
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        read_mapping(tmp_path / "absent.toml")


def test_every_unit_that_is_no_length_or_force_asks_for_its_scale():
    for unit in NEEDS_SCALE:
        which = LENGTHS if unit in LENGTHS else FORCES
        key = "position" if which is LENGTHS else "force"
        other = '[force]\ncolumn="f"\nunit="N"' if key == "position" else '[position]\ncolumn="x"\nunit="m"'
        with pytest.raises(RecordingError, match="needs scale"):
            parse_mapping("map", f'[{key}]\ncolumn="y"\nunit="{unit}"\n{other}')


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("time_s", TIME, "s"), ("Zeit [ms]", TIME, "ms"), ("Temps (s)", TIME, "s"), ("tiempo/s", TIME, "s"),
        ("timestamp", TIME, ""), ("时间 [s]", TIME, "s"), ("t", TIME, ""), ("t [µs]", TIME, "us"),
        ("position_m", POSITION, "m"), ("Weg [mm]", POSITION, "mm"), ("Déplacement (mm)", POSITION, "mm"),
        ("profundidad en mm", POSITION, "mm"), ("Posição [µm]", POSITION, "um"), ("位置[mm]", POSITION, "mm"),
        ("toolPosition", POSITION, ""), ("x", POSITION, ""), ("lever position_rad", POSITION, "rad"),
        ("force_N", FORCE, "N"), ("Kraft [mN]", FORCE, "mN"), ("Zugkraft [cN]", FORCE, "cN"), ("fuerza", FORCE, ""),
        ("Kraft in N", FORCE, "N"), ("сила", FORCE, ""), ("run1/force_kN", FORCE, "kN"), ("Fz", FORCE, ""),
        ("Extension (mm)", POSITION, "mm"), ("Compressive extension", POSITION, ""), ("Crosshead", POSITION, ""),
        ("Stroke", POSITION, ""), ("Disp.", POSITION, ""), ("Deflection [mm]", POSITION, "mm"),
        ("Elongation [mm]", POSITION, "mm"), ("Traverse [mm]", POSITION, "mm"), ("Hub", POSITION, ""),
        ("Prüfzeit [s]", TIME, "s"), ("Standardweg [mm]", POSITION, "mm"), ("Standardkraft [kN]", FORCE, "kN"),
        ("Traversenweg", POSITION, ""), ("Prüfkraft", FORCE, ""), ("Prüflast", FORCE, ""), ("Kolbenhub", POSITION, ""),
        ("Längenänderung", POSITION, ""), ("Running Time", TIME, ""), ("Axial Force (kN)", FORCE, "kN"),
        ("travel", POSITION, ""), ("indent_mm", POSITION, "mm"), ("Indentation depth [um]", POSITION, "um"),
        ("penetration (mm)", POSITION, "mm"), ("Compression [mm]", POSITION, "mm"), ("Pénétration", POSITION, ""),
        ("Stauchung [mm]", POSITION, "mm"), ("Eindringweg", POSITION, ""), ("indentación", POSITION, ""),
        ("Compressione [mm]", POSITION, "mm"), ("indentação", POSITION, ""), ("压缩[mm]", POSITION, "mm"),
        ("Compression force [N]", FORCE, "N"), ("Indentation load (mN)", FORCE, "mN"), ("сжатие", POSITION, ""),
    ],
)  # fmt: skip
def test_names_in_several_languages_are_understood(name, quantity, unit):
    named = name_says(name)
    scores = {one: rank(one, named)[0] for one in (TIME, POSITION, FORCE)}
    assert max(scores, key=scores.get) == quantity
    assert rank(quantity, named) == (scores[quantity], unit)
    assert scores[quantity] > 0.0


@pytest.mark.parametrize(
    "name",
    [
        "force [mm]",
        "position [N]",
        "velocity_m_s",
        "torque force [Nm]",
        "note",
        "index",
        "Sollkraft",
        "blast",
        "level",
        "Kraftgeschwindigkeit",
    ],
)
def test_names_that_contradict_their_unit_are_not_taken(name):
    quantity = {"p": POSITION}.get(name[0], FORCE)
    assert rank(quantity, name_says(name))[0] == 0.0


@pytest.mark.parametrize(
    "name", ["Indentation force", "Force de compression", "fuerza de indentación", "Load, penetration"]
)
def test_a_force_that_presses_is_no_position(name):
    assert rank(POSITION, name_says(name))[0] == 0.0
    assert rank(FORCE, name_says(name))[0] > 0.0


@pytest.mark.parametrize("name", ["Elongation (%)", "Sollweg [mm]", "Prüfgeschwindigkeit [mm/s]", "Crosshead speed"])
def test_what_is_no_measured_position(name):
    assert rank(POSITION, name_says(name))[0] == 0.0
