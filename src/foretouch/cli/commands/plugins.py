"""Commands about robots, devices, materials and estimators, of foretouch and of other packages."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import Json, print_json, show
from foretouch.errors import plural, was_or_were

if TYPE_CHECKING:
    from foretouch.session.conformance import Finding

plugins = typer.Typer(help="Robots, devices, materials and estimators: what there is, and whether it works.")

BROKEN = "broken"
MARKS = {True: "kept", False: "BROKEN", None: "not seen"}


@plugins.callback(invoke_without_command=True)
def list_plugins(context: typer.Context, json_output: Json = False) -> None:
    """Robots, devices, materials and estimators, of foretouch and of other packages; the broken ones with the reason.

    Example: foretouch plugins --json
    """
    if context.invoked_subcommand is not None:
        return
    from foretouch.session.conformance import catalogue

    entries = catalogue()
    if json_output:
        rows = [dataclasses.asdict(entry) | {"status": BROKEN if entry.problem else "ok"} for entry in entries]
        print_json({"plugins": rows})
        return
    for entry in entries:
        laws = f"  of {', '.join(entry.laws)}" if entry.laws else ""
        show(f"{entry.kind:<10} {entry.name:<20} {entry.package} {entry.version}{laws}")
        if entry.problem:
            show(f"{'':<10} {BROKEN}: {entry.problem}")


@plugins.command("check")
def check(
    name: Annotated[str, typer.Argument(help="Of a robot, device, material or estimator.")],
    group: Annotated[
        str, typer.Option(help="robot, device, material or estimator; needed where two of them have the name.")
    ] = "",
    move: Annotated[bool, typer.Option("--move", help="Let a real robot move, 5 mm in and back, in free air.")] = False,
    json_output: Json = False,
) -> None:
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
        show(f"  {MARKS[finding.passed]:<9} {finding.check:<28} {finding.found}")
        if finding.passed is False:
            show(f"  {'':<9} {'':<28} the rule: {finding.rule}")

    titled = check_named(name, kind=kind, move=move, tell=(lambda of, finding: None) if json_output else tell)
    found = [finding for findings in titled.values() for finding in findings]
    broken = failed(found)
    if json_output:
        rows = [dataclasses.asdict(finding) | {"of": of} for of, findings in titled.items() for finding in findings]
        print_json({"name": name, "passed": not broken, "checks": rows})
    else:
        show(_summary(found))
    if broken:
        raise typer.Exit(1)


def _summary(found: Sequence[Finding]) -> str:
    """How many rules are kept, or broken; how many were not seen, and how many of those ``--move`` shows."""
    kept, broken, unseen = ([one for one in found if one.passed is passed] for passed in (True, False, None))
    if not (broken or unseen):
        return "every rule is kept"
    told, kind = (broken, "not kept") if broken else (kept, "kept")
    said = f"{plural(len(told), 'rule')} {'is' if len(told) == 1 else 'are'} {kind}"
    if unseen:
        said += f", {len(unseen)} {was_or_were(len(unseen))} not seen"
    movable = sum("--move" in finding.found for finding in unseen)
    return said + (f"; --move shows {movable} of them" if movable else "")
