"""Commands that pass a running session on to something else."""

from __future__ import annotations

from typing import Annotated

import typer

from foretouch.cli.links import ENDED, Endpoints, open_link, with_endpoints
from foretouch.cli.options import Json, Parent, print_json, say
from foretouch.errors import LinkError, plural

__all__ = ["bridge"]

bridge = typer.Typer(help="Pass a running session on to other systems.", no_args_is_help=True)


@bridge.callback()
def _bridge() -> None:
    pass


@bridge.command("ros2")
@with_endpoints
def ros2(
    *,
    endpoints: Endpoints,
    router: Annotated[
        str, typer.Option(help="Of the ROS 2 graph; rmw_zenoh_cpp's own listens here.")
    ] = "tcp/127.0.0.1:7447",
    domain: Annotated[int, typer.Option(envvar="ROS_DOMAIN_ID", help="Of the ROS 2 graph, 0 to 232.")] = 0,
    namespace: Annotated[str, typer.Option(help="Before the names of the topics, such as /robot1.")] = "/",
    rate: Annotated[float, typer.Option(help="Messages a second of each topic at most.")] = 100.0,
    json_output: Json = False,
    parent: Parent = None,
) -> None:
    """Publish a session's wrench, joint states, pose and contact model for ROS 2, which need not be installed here.

    Example: foretouch bridge ros2 --connect tcp/127.0.0.1:7451 --connect tcp/127.0.0.1:7452
    """
    from foretouch.ros2 import BRIDGE_CHANNELS, Bridge, Graph, Node
    from foretouch.session import StopFlag, give_way, orphaned

    if router in endpoints.all:
        raise LinkError(f"{router} cannot be the session's and the ROS 2 router's: give the session another port")
    graph = Graph(router, Node(domain, namespace), insecure=endpoints.insecure)
    passes_on = Bridge(graph, rate=rate, router=router, say=say)
    give_way()
    stop = StopFlag().on_signals()
    try:
        with open_link("bridge", endpoints, BRIDGE_CHANNELS) as link:
            passes_on.run(link, lambda: bool(stop.reason or link.other_version()) or orphaned(parent))
            if (error := link.other_version()) is not None:
                raise error
    finally:
        graph.close()
    if json_output:
        print_json({"ended": stop.reason or ENDED, "sent": graph.sent, "unsent": graph.unsent})
    for name, count in sorted(graph.sent.items()):
        say(f"bridge: {name} {plural(count, 'message')}")
