"""What `ros2 topic list` and `ros2 topic info -v` do, by another implementation, in a process of its own.

Usage: topic_list.py ROUTER_PORT DOMAIN; prints one JSON object: by topic, its types and who publishes it.
"""

from __future__ import annotations

import dataclasses
import json
import sys

from zenoh_ros2_sdk.discovery import get_topic_info, get_topic_names_and_types


def main(port: int, domain: int) -> None:
    topics = {}
    for name, types in get_topic_names_and_types(domain_id=domain, router_port=port):
        info = get_topic_info(name, domain_id=domain, router_port=port, verbose=True)
        assert info is not None
        topics[name] = {"types": types, "publishers": [dataclasses.asdict(publisher) for publisher in info.publishers]}
    sys.stdout.write(json.dumps(topics))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
