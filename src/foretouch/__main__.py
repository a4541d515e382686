"""`python -m foretouch` is the `foretouch` command."""

from foretouch.cli import main

main()
