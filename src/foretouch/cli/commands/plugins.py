"""Commands about robots, devices, materials and estimators, of foretouch and of other packages."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import Answer, command, show
from foretouch.cli.progress import progress_bar
from foretouch.errors import UnknownNameError, plural, was_or_were

if TYPE_CHECKING:
    from foretouch.session.conformance import Finding

ALL = "all"

arms = typer.Typer(help="Simulated arms: meshes for their picture in the console.", no_args_is_help=True)

plugins = typer.Typer(help="Robots, devices, materials and estimators: what there is, and whether it works.")

BROKEN = "broken"
MARKS = {True: "kept", False: "BROKEN", None: "not seen"}


@plugins.callback(invoke_without_command=True)
@command()
def list_plugins(context: typer.Context) -> Answer | None:
    """Robots, devices, materials and estimators, of foretouch and of other packages; the broken ones with the reason.

    Example: foretouch plugins --json
    """
    if context.invoked_subcommand is not None:
        return None
    from foretouch.session.conformance import catalogue

    rows, lines = [], []
    for entry in catalogue():
        rows.append(dataclasses.asdict(entry) | {"status": BROKEN if entry.problem else "ok"})
        laws = f"  of {', '.join(entry.laws)}" if entry.laws else ""
        lines.append(f"{entry.kind:<10} {entry.name:<20} {entry.package} {entry.version}{laws}")
        if entry.problem:
            lines.append(f"{'':<10} {BROKEN}: {entry.problem}")
    return Answer({"plugins": rows}, lines)


@plugins.command("check")
@command()
def check(
    *,
    name: Annotated[str, typer.Argument(help="Of a robot, device, material or estimator.")],
    group: Annotated[
        str, typer.Option(help="robot, device, material or estimator; needed where two of them have the name.")
    ] = "",
    move: Annotated[bool, typer.Option("--move", help="Let a real robot move, 5 mm in and back, in free air.")] = False,
    json_output: bool,
) -> Answer:
    """Check that a robot, device, material or estimator keeps to what sessions count on. Exit code 1 where not.

    Example: foretouch plugins check hunt-crossley --group material
    """
    from foretouch.session.conformance import check_named, failed

    kind = group.removeprefix("foretouch.").removesuffix("s")
    headed: set[str] = set()

    def tell(of: str, finding: Finding) -> None:
        """Print what is known at once: a check of a device takes seconds."""
        if of not in headed:
            show(of)
            headed.add(of)
        show(f"  {MARKS[finding.passed]:<9} {finding.check:<28} {finding.summary}")
        if finding.passed is False:
            show(f"  {'':<9} {'':<28} the rule: {finding.rule}")

    titled = check_named(name, kind=kind, move=move, tell=(lambda of, finding: None) if json_output else tell)
    results = [finding for findings in titled.values() for finding in findings]
    broken = bool(failed(results))
    rows = [dataclasses.asdict(finding) | {"of": of} for of, findings in titled.items() for finding in findings]
    return Answer({"name": name, "passed": not broken, "checks": rows}, _summary(results), code=int(broken))


def _summary(result: Sequence[Finding]) -> str:
    """How many rules are kept, or broken; how many were not seen, and how many of those ``--move`` shows."""
    kept, broken, unseen = ([one for one in result if one.passed is passed] for passed in (True, False, None))
    if not (broken or unseen):
        return "every rule is kept"
    reported, kind = (broken, "not kept") if broken else (kept, "kept")
    text = f"{plural(len(reported), 'rule')} {'is' if len(reported) == 1 else 'are'} {kind}"
    if unseen:
        text += f", {len(unseen)} {was_or_were(len(unseen))} not seen"
    movable = sum("--move" in finding.summary for finding in unseen)
    return text + (f"; --move shows {movable} of them" if movable else "")


@arms.callback()
def _root() -> None:
    """Keep `meshes` a word of its own while it is the only command."""


@arms.command("meshes")
@command()
def meshes(name: Annotated[str, typer.Argument(help="fr3, ur5e, so101 or all.")]) -> Answer:
    """Make the meshes of a simulated arm available here, and print where they lie; the console draws it with them.

    They come from the folder that FORETOUCH_DATA_DIR names, from the cache, or from MuJoCo Menagerie at one commit. No
    checksum of them is known: they are read, and compared with the arm.

    Example: foretouch arms meshes fr3
    """
    from foretouch.robot import ARM_MESHES, fetch_arm_meshes

    if name not in (*ARM_MESHES, ALL):
        raise UnknownNameError("arm with meshes", name, (*ARM_MESHES, ALL))
    names = list(ARM_MESHES) if name == ALL else [name]
    content, lines = {}, []
    with progress_bar(f"fetching meshes of {name}") as bar:
        bar.pulse()
        for done, each in enumerate(names):
            bar.update(done, len(names), f"fetching meshes of {each}")
            path, licence = fetch_arm_meshes(each), ARM_MESHES[each].licence
            content[each] = {"file": str(path), "licence": licence}
            lines.append(f"{path}   {licence}")
    return Answer(content, lines)
