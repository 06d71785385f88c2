"""`python -m faultgen` is the command `faultgen`."""

from faultgen.cli import main

main()
