"""What each measured block of the pages depends on: where its measuring begins in the sources.

From there `sources.Sources` follows all names. A block is of the code as it is while the digest of what is reached is
the one that stands in its header.
"""

from __future__ import annotations

import gc
from pathlib import Path

from sources import Definition, Sources, digest_of

__all__ = ["BLOCKS", "IGNORED", "ROOT", "Key", "digests", "reached_by", "sources_of"]

ROOT = Path(__file__).resolve().parents[1]

Key = tuple[str, str]
"""Page below the root, and name of the block in it."""

IGNORED = (
    # what only says, shows or refuses
    *("measured_blocks", "foretouch.console", "foretouch.errors", "foretouch.plugins", "foretouch.ros2"),
    *("foretouch.core.compiling", "foretouch.session.latency", "foretouch.report.sections.latency"),
    *(f"foretouch.files.{name}" for name in ("budget", "children", "toml", "within")),
    "foretouch.robot.arms.meshes",
    *(f"foretouch.cli.{name}" for name in ("app", "options", "progress")),
    *("foretouch.report.writing", "foretouch.report.drawing", "foretouch.report.sections.scene"),
    *("foretouch.comparison.figures", "foretouch.comparison.page", "foretouch.sweep.page"),
    # devices that no simulated session has
    *(
        f"foretouch.devices.{name}"
        for name in ("browser", "felt", "force_dimension", "gamepad", "inverse3", "spacemouse")
    ),
    # robots and devices that are real, or another package's
    *("foretouch.robot.drivers", *(f"foretouch.session.operators:foreign_{one}" for one in ("robot", "operator"))),
    # what writes recordings, and formats that no measured file has
    *("foretouch.recordings.output", "foretouch.recordings.session.repair", "foretouch.recordings.session.writer"),
    *(f"foretouch.recordings.formats.{name}" for name in ("bags", "cdr", "mcap", "mcap_index", "topics")),
    *(f"foretouch.recordings.meaning.{name}" for name in ("guess", "mapped", "mapping")),
    "foretouch.recordings.formats.tables",
)
"""Nothing in these moves a figure, so what is in them makes no block stale."""

ARMS, ARMS_PAGE = ("foretouch.robot.arms",), "docs/arms.md"
"""Nor does an arm move a figure of another page than this: their sessions are the plain robot's."""

COMPARE = "foretouch.cli.commands.studies:compare"
EXCERPT = "foretouch.recordings.datasets:excerpt"
IDENTIFY = "foretouch.cli.commands.offline:identify"
PREDICT = "foretouch.cli.commands.offline:predict"
LIVE = (
    "foretouch.cli.commands.sessions:teleop",
    "foretouch.cli.commands.sides:leader",
    "foretouch.cli.commands.sides:follower",
    "foretouch.cli.commands.watchers:record",
)
"""The processes of a session in real time."""

REPLAY = "foretouch.cli.commands.sessions:replay"
SIMULATE = "foretouch.cli.commands.sessions:simulate"
SWEEP = ("draw_sweep:main", "foretouch.cli.commands.studies:sweep")
THIN = SIMULATE, "foretouch.session.thin.ends:End"

TUNED = ("designs.tuned:predict_all", "designs.tuned:install", "designs.tuned:Finder")
"""What a process of its own does with one number changed."""

_OF_PAGES: dict[str, dict[str, tuple[str, ...]]] = {
    "README.md": {"session": ("measure_results:session", SIMULATE)},
    "docs/baselines.md": {"compared": ("compare_baselines:compared",)},
    "docs/console.md": {"console": ("measure_console:main", *LIVE, "foretouch.cli.commands.watchers:console")},
    "docs/contact-map.md": {
        "floors": ("measure_results:floors", IDENTIFY, EXCERPT),
        "changes": ("measure_changes:changes", "measure_changes:noticed"),
        "memory": ("measure_memory:memory",),
        "leave-rig-out": ("sensitivities:leave_rig_out", *TUNED),
        "designs": ("compare_designs:measure", "compare_designs:cells", "compare_designs:shown"),
    },
    "docs/export.md": {
        "sizes": ("measure_export:sizes", "foretouch.export.package:write_package"),
        "gate": ("measure_export:gate", "foretouch.cli.commands.sides:gate"),
        "bits": ("measure_bits:bits", SIMULATE, "foretouch.export.package:write_package"),
        "interpreted": ("measure_bits:interpreted", SIMULATE, "foretouch.export.package:write_package"),
        "ticks": (
            *("measure_bits:ticks", "foretouch.session.steps.leading:tick", "foretouch.export.package:write_package"),
        ),
    },
    "docs/thin-links.md": {
        **{name: (f"measure_budget:{name}", *THIN) for name in ("budgets", "losses", "traces")},
        "delayed": ("measure_budget:felt_late", *THIN),
        "overhead": ("measure_budget:overhead", *LIVE),
        "cost": ("measure_budget:cost", "foretouch.session.thin.ends:End"),
        "sweep": SWEEP,
    },
    "docs/faults.md": {"faults": ("measure_faults:main", "test_session_soak_fire", *LIVE)},
    "docs/identifiability.md": dict.fromkeys(("bounds", "twins"), ("draw_identifiability:shares",)),
    "docs/replay.md": {"replays": ("measure_results:replays", SIMULATE, REPLAY)},
    "docs/results.md": {
        "reach": ("measure_results:reach", PREDICT, COMPARE, EXCERPT),
        "reach-by-kind": ("measure_results:reach_by_kind", PREDICT, EXCERPT),
        "reach-simulated": ("beyond_files:beyond", "beyond_files:ASKED"),
        "claims": (
            "measure_results:claims",
            *(f"foretouch.reproduction.{part}.*" for part in ("figures", "questions")),
        ),
        "sessions": ("measure_results:sessions", SIMULATE),
        "foam": ("measure_results:foam", "foretouch.robot.materials.foam_fit:fit_foam", EXCERPT),
    },
    "docs/rooms/identification.md": {"sensor-faults": ("measure_sensor_faults:sensor_faults",)},
    "docs/rooms/vision.md": {"vision": ("measure_vision:main",)},
    "docs/safety.md": {name: (f"measure_impacts:{name}",) for name in ("impacts", "sessions", "unloading")}
    | {"in-the-way": ("measure_impacts:in_the_way",)}
    | {"lying-sensors": ("measure_sensor_faults:lying_sensors",)}
    | {"blind-sensors": ("measure_sensor_faults:blind_sensors",)},
    "docs/scale.md": {"costs": ("measure_scale:costs", "foretouch.recordings.session.writer", *LIVE)},
    ARMS_PAGE: {
        name: (f"measure_arms:{name}",) for name in ("line", "grips", "scenes", "speed", "links", "weight", "ceilings")
    },
    "docs/scenes.md": {
        **{name: (f"measure_scenes:{name}",) for name in ("fusion", "images", "blind", "palpation", "hand")},
        **dict.fromkeys(("seeds", "maps"), ("measure_seeds:main",)),
    },
    "docs/sensitivities.md": {"sensitivities": ("sensitivities:sensitivities", *TUNED)},
    "docs/speed.md": {
        "machine": ("measure_speed:machine",),
        **{
            name: ("measure_speed:block", f"foretouch.bench.benchmarks.{module}:measure_{name}", *also)
            for module, names, *also in (
                ("updates", "fprls call map mesh"),
                ("steps", "steps simulate"),
                ("streams", "batch"),
                ("streams", "growth", IDENTIFY),
                ("commands", "startup"),
                ("commands", "identify", IDENTIFY),
                ("commands", "compare", COMPARE),
                ("profile", "profile"),
                ("link", "link"),
                ("loops", "loops", *LIVE),
            )
            for name in names.split()
        },
    },
    "docs/stability.md": {
        "mediation": ("measure_results:mediation", EXCERPT),
        "first-touch": ("measure_results:first_touch", SIMULATE),
        "device-delay": ("measure_results:device_delay", SIMULATE),
        "guarded-peaks": ("measure_results:guarded_peaks", SIMULATE),
    },
    "docs/surfaces.md": {
        "god-object": ("measure_surfaces:god_object",),
        "palpation": ("measure_surfaces:palpation",),
        "places": ("compare_places:compared",),
        "spots": ("measure_spots:rasters",),
    },
    "docs/sweep.md": {"totals": SWEEP},
}

BLOCKS: dict[Key, tuple[str, ...]] = {
    (page, name): roots for page, blocks in _OF_PAGES.items() for name, roots in blocks.items()
}
"""Where the measuring of each block begins: the function of the script, and the commands that it runs."""


def sources_of() -> Sources:
    """Of the package, of the scripts of the documentation, and of the parts of the tests that these use."""
    return Sources(
        [ROOT / folder for folder in ("src", "docs", "tests/session", "tests/console", "tests/identification")]
    )


def reached_by(key: Key, sources: Sources) -> dict[Definition, str]:
    """Every definition that a block depends on, and its digest."""
    return sources.reached(BLOCKS[key], IGNORED if key[0] == ARMS_PAGE else IGNORED + ARMS)


def digests(sources: Sources) -> dict[Key, str]:
    """The digest of what each block depends on."""
    gc.disable()  # syntax trees are many small objects, and all of them stay
    try:
        return {key: digest_of(reached_by(key, sources)) for key in BLOCKS}
    finally:
        gc.enable()
