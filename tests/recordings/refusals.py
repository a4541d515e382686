"""What tests of all formats share: a recording that must be refused, in one line that names a file."""

import pytest

from foretouch.errors import RecordingError
from foretouch.recordings import read_with_notes


def refusal(path, **options):
    """The error of a recording that must be refused."""
    with pytest.raises(RecordingError) as caught:
        read_with_notes(path, **options)
    output = str(caught.value)
    assert "\n" not in output
    assert output.startswith((str(path), str(options.get("map_file", path))))
    return caught.value


def refused(path, **options):
    """Its line."""
    return str(refusal(path, **options))
