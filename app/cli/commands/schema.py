"""Print the JSON Schema of case, live, expected, world, control or cohort.yaml.

An editor with a YAML language server completes keys with it, shows their descriptions and marks
errors. The schema is generated from the declarations that the reader of the file uses. A few rules
cannot be stated in JSON Schema: it lists them as comments.
"""

import argparse

from app.cli.options import file_path

SUMMARY = "print the JSON Schema of case, live, expected, world, control or cohort.yaml"
NAMES = ("case", "live", "expected", "world", "control", "cohort")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard schema``."""
    parser.add_argument("document", choices=NAMES, help="the file that the schema describes")
    parser.add_argument(
        "-o",
        "--output",
        type=file_path(".json"),
        metavar="FILE",
        help="write the schema to FILE (.json)",
    )


def run(options: argparse.Namespace) -> int:
    """Print the schema, or write it to a file."""
    from app.case import schema_text
    from app.cohort import cohort_schema_text
    from app.control import control_schema_text
    from app.files import write_file
    from app.simulation import world_schema_text

    others = {
        "world": world_schema_text,
        "control": control_schema_text,
        "cohort": cohort_schema_text,
    }
    make = others.get(options.document)
    text = schema_text(options.document) if make is None else make()
    if options.output is None:
        print(text, end="")
        return 0
    write_file(options.output, text.encode())
    print(f"wrote {options.output}")
    return 0
