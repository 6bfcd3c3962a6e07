"""Print the JSON Schema of case.yaml, live.yaml, expected.yaml or world.yaml.

An editor with a YAML language server completes keys with it, shows their descriptions and marks
errors. The schema is generated from the declarations that the reader of the file uses. A few rules
cannot be stated in JSON Schema: it lists them as comments.
"""

import argparse

from app.cli.options import file_path

SUMMARY = "print the JSON Schema of case.yaml, live.yaml, expected.yaml or world.yaml"
NAMES = ("case", "live", "expected", "world")


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
    from app.files import write_file
    from app.simulation import world_schema_text

    is_world = options.document == "world"
    text = world_schema_text() if is_world else schema_text(options.document)
    if options.output is None:
        print(text, end="")
        return 0
    write_file(options.output, text.encode())
    print(f"wrote {options.output}")
    return 0
