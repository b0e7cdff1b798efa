"""Run the cells of a notebook as plain Python and keep what they print, return and draw.

    python docs/site/notebook.py docs/log_to_decision.ipynb

writes the notebook anew with its outputs, and the first study's picture for the README. Jupyter is not needed; a figure
becomes a picture where a Chromium and playwright are there, else a line of text. Cells share one namespace and run in a
folder of their own that has the project's `scenarios`.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
WIDTH, MOST_HEIGHT = 860, 900  # px of a picture
LONGEST_S = 300.0  # for a browser on a busy computer


def cells_of(notebook: Path, kind: str = "code") -> list[str]:
    """The source of each cell of one kind, in order."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == kind]


def run_cell(source: str, names: dict[str, Any], number: int) -> tuple[str, Any]:
    """What the cell prints, and the value of its last line where that is an expression."""
    tree = ast.parse(source)
    last = None
    if tree.body and isinstance(final := tree.body[-1], ast.Expr):
        last, tree.body = final, tree.body[:-1]
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(tree, f"cell {number}", "exec"), names)
        value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names) if last else None
    return printed.getvalue(), value


def outputs(printed: str, value: Any, number: int) -> list[dict[str, Any]]:
    """As a notebook keeps them: text, a table as HTML beside its text, a figure as a picture."""
    kept: list[dict[str, Any]] = []
    if printed:
        kept.append({"output_type": "stream", "name": "stdout", "text": printed.splitlines(keepends=True)})
    if value is None:
        return kept
    data: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
    if type(value).__module__.startswith("plotly."):
        data = picture(value)
    elif hasattr(value, "_repr_html_"):
        data["text/html"] = value._repr_html_()
    return [*kept, {"output_type": "execute_result", "execution_count": number, "data": data, "metadata": {}}]


def picture(figure: Any, width: int = WIDTH) -> dict[str, Any]:
    """The figure as PNG, drawn by a browser, beside a line of text."""
    text = f"Figure: {(figure.layout.title.text or '').replace('<br>', ' ')}"
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        return {"text/plain": [text]}
    from playwright.sync_api import sync_playwright

    height = min(int(figure.layout.height or 500), MOST_HEIGHT)
    figure = figure.update_layout(width=width, height=height)
    page_text = figure.to_html(include_plotlyjs=True, config={"displayModeBar": False, "staticPlot": True})
    with sync_playwright() as play:
        chromium = play.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        page = chromium.new_page(viewport={"width": width + 16, "height": height + 16})
        page.set_default_timeout(1000.0 * LONGEST_S)
        page.set_content(page_text)
        page.wait_for_selector(".main-svg")
        shot = page.locator(".plotly-graph-div").screenshot()
        chromium.close()
    return {"text/plain": [text], "image/png": base64.b64encode(shot).decode()}


def execute(notebook: Path) -> None:
    """Run all cells and write the notebook with their outputs."""
    content = json.loads(notebook.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    number = 0
    for cell in content["cells"]:
        if cell["cell_type"] == "code":
            number += 1
            cell["outputs"] = outputs(*run_cell("".join(cell["source"]), names, number), number)
            cell["execution_count"] = number
    notebook.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def first_study(file: Path) -> None:
    """The picture of the README: the start of the first study's first move."""
    import workbench

    shown = picture(workbench.study("scenarios/payloads.yaml").plot("start"), 1240)
    file.write_bytes(base64.b64decode(shown["image/png"]))


if __name__ == "__main__":
    file = Path(sys.argv[1]).resolve()
    sys.path.insert(0, str(ROOT))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scenarios").symlink_to(ROOT / "scenarios")
        os.chdir(folder)
        execute(file)
        first_study(file.parent / "img" / "first_study.png")
