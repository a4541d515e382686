"""The console: a session in a browser, which watches messages and publishes what a person does there.

It never imports a step and moves no bytes: the caller gives it what arrives and sends what it publishes.
"""

from foretouch.console.console import Console
from foretouch.console.gate.entrance import require_free_port

__all__ = ["Console", "require_free_port"]
