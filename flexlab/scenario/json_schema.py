"""The JSON schema of scenario files, with which editors complete, explain and check them while one types.

`flexlab presets --schema` writes it to where scenario files in a folder `presets` look for it.
"""

import json
from pathlib import Path
from typing import Any

from flexlab.scenario.scenario import FORMAT, FORMAT_FIELD, MENU_FIELD, SCHEMA_FIELD, Scenario

REFERENCE = "schema/scenario.json"
"""Where the schema lies beside presets, as they name it."""
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scenario_schema() -> dict[str, Any]:
    """The schema, with the range of every number."""
    schema = Scenario.model_json_schema()
    schema["properties"] |= {
        SCHEMA_FIELD: {"type": "string", "description": "Where this schema lies, for editors."},
        FORMAT_FIELD: {"type": "integer", "minimum": 1, "maximum": FORMAT, "description": "Format of this file."},
        MENU_FIELD: {
            "type": "integer",
            "description": "Place among the presets of its folder: a smaller number first.",
        },
    }
    return {SCHEMA_FIELD: DIALECT, **schema}


def write_schema(presets: Path) -> Path:
    """Write the schema beside the files of a folder `presets`; returns its file. Raises OSError."""
    file = presets / REFERENCE
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(
        json.dumps(scenario_schema(), indent=1, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    return file
