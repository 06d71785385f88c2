"""Logs of robot controllers: tables of columns, and maps that say what each column means.

A map is a TOML file; some come with the package as presets. This package reads a log into named
arrays in SI units. `faultgen.recordings.import_log` makes a recording of them.

column_map = load_map("columns.toml", preset="ur_rtde")
arranged(read_log("log.csv", column_map.file), column_map).named["joint_position"]
"""

from faultgen.importing.arrange import Arranged, Row, arranged
from faultgen.importing.column_map import ColumnMap, load_map, map_of, preset_names, preset_text
from faultgen.importing.read_log import read_log, table_of_frame
from faultgen.importing.table import Table

__all__ = [
    "Arranged",
    "ColumnMap",
    "Row",
    "Table",
    "arranged",
    "load_map",
    "map_of",
    "preset_names",
    "preset_text",
    "read_log",
    "table_of_frame",
]
