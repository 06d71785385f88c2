"""python -m faultgen.cli."""

from faultgen.cli import main

main()
