"""The file ``croissant.json``, which describes a folder of Parquet files to other programs.

It states the checksum of every file, and for each configuration the records that the files hold,
with the type, the unit and the meaning of every column.

Source: Croissant 1.0, https://docs.mlcommons.org/croissant/docs/croissant-spec.html.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from faultgen.dataset.card import LICENCE
from faultgen.export.cycles import LABELS, Source
from faultgen.export.hub_card import description, title
from faultgen.export.hub_tables import Tables
from faultgen.system.files import file_sha256
from faultgen.system.tables import optional

_TERMS = (
    *(
        "arrayShape",
        "citeAs",
        "column",
        "data",
        "dataType",
        "equivalentProperty",
        "examples",
        "extract",
        "field",
    ),
    *("fileProperty", "fileObject", "fileSet", "format", "includes", "isArray", "isLiveDataset"),
    *("jsonPath", "key", "md5", "parentField", "path", "recordSet", "references", "regex"),
    *("repeated", "replace", "samplingRate", "separator", "source", "subField", "transform"),
)
_SPECIAL = {
    "data": {"@id": "cr:data", "@type": "@json"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
}
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    **{name: f"cr:{name}" for name in _TERMS},
    **_SPECIAL,
}
"""What the terms of the file mean."""


def write_croissant(folder: Path, tables: Tables, source: Source) -> None:
    """Write ``croissant.json``.

    Args:
        folder: The folder.
        tables: What has been written to it.
        source: The runs.
    """
    files, records = [], []
    for config, parts in tables.files.items():
        for path in (path for paths in parts.values() for path in paths):
            files.append(
                {
                    "@type": "cr:FileObject",
                    "@id": path.as_posix(),
                    "name": path.as_posix(),
                    "contentUrl": path.as_posix(),
                    "contentSize": f"{(folder / path).stat().st_size} B",
                    "encodingFormat": "application/x-parquet",
                    "sha256": file_sha256(folder / path),
                }
            )
        for split, paths in parts.items():
            for number, path in enumerate(paths):
                name = f"{config}_{split}" + (f"_{number}" if len(paths) > 1 else "")
                records.append(_record_set(name, path.as_posix(), config, tables))
    version = source.runs[0].attributes["faultgen_version"]
    content = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": title(source).replace(" ", "_"),
        "description": description(source),
        "license": LICENCE,
        "version": "1.0.0",
        "creator": {"@type": "sc:Organization", "name": "The faultgen developers"},
        "citeAs": f"The faultgen developers: {title(source)}. Made by faultgen {version}.",
        "distribution": files,
        "recordSet": records,
    }
    (folder / "croissant.json").write_text(json.dumps(content, indent=2) + "\n")


def _record_set(name: str, file: str, config: str, tables: Tables) -> dict[str, Any]:
    fields = []
    for field in tables.schemas[config]:
        array = optional("pyarrow").types.is_nested(field.type)
        kind = field.type.value_type if array else field.type
        told: dict[str, Any] = {
            "@type": "cr:Field",
            "@id": f"{name}/{field.name}",
            "name": f"{name}/{field.name}",
            "description": _described(field.name, tables),
            "dataType": _data_type(str(kind)),
            "source": {"fileObject": {"@id": file}, "extract": {"column": field.name}},
        }
        if array:
            told |= {"isArray": True, "arrayShape": str(getattr(field.type, "list_size", -1))}
        fields.append(told)
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "field": fields}


def _described(column: str, tables: Tables) -> str:
    text = LABELS[column][1] if column in LABELS else column.replace("_", " ")
    units = tables.units.get(column)
    return f"{text} [{units}]" if units and units != "1" else text


def _data_type(kind: str) -> str:
    names = {"string": "sc:Text", "large_string": "sc:Text", "bool": "sc:Boolean"}
    names |= {"int64": "cr:Int64", "float": "cr:Float32", "double": "cr:Float64"}
    return names[kind]
