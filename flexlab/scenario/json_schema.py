"""The JSON schema of scenario files, with which editors complete, explain and check them while one types.

`python -m flexlab.scenario.json_schema` writes it anew after a field was changed.
"""

import json
from pathlib import Path
from typing import Any

from flexlab.assets import presets_folder
from flexlab.scenario.scenario import SCHEMA_FIELD, Scenario

REFERENCE = "schema/scenario.json"
"""Where the schema lies beside flexlab's own presets, as they name it."""
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def scenario_schema() -> dict[str, Any]:
    """The schema, with the range of every number."""
    schema = Scenario.model_json_schema()
    schema["properties"][SCHEMA_FIELD] = {"type": "string", "description": "Where this schema lies, for editors."}
    return {SCHEMA_FIELD: DIALECT, **schema}


def schema_text() -> str:
    """The schema as its file holds it."""
    return json.dumps(scenario_schema(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def schema_file() -> Path:
    """The file that comes with flexlab."""
    return presets_folder() / REFERENCE


if __name__ == "__main__":
    schema_file().parent.mkdir(exist_ok=True)
    schema_file().write_text(schema_text(), encoding="utf-8")
