"""Commands as a user types them, in the process of the tests, and what they must come to."""

from __future__ import annotations

import json
from typing import Any

from typer.testing import CliRunner, Result

from foretouch.cli.app import app
from foretouch.errors import ForetouchError


def run(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def good(*words: object) -> Result:
    """The result of a command that must succeed."""
    result = run(*words)
    assert result.exit_code == 0, f"{result.exception}\n{result.output}"
    return result


def output_of(*words: object) -> dict[str, Any]:
    """The one JSON object that a command prints."""
    content = json.loads(good(*words, "--json").stdout)
    assert isinstance(content, dict)
    return content


def refusal_of(*words: object) -> str:
    """The error line of a command that must be refused."""
    result = run(*words)
    assert isinstance(result.exception, ForetouchError), result.output
    assert not result.stdout
    assert "\n" not in str(result.exception)
    return str(result.exception)
