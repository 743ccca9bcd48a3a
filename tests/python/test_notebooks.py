"""The cells of the notebooks run, one after the other. tools/notebooks renders them with a kernel."""
import json
import os
import pathlib
import unittest

FOLDER = pathlib.Path(os.environ["TWINRATE_SOURCE_DIR"]) / "examples/notebooks"


class Notebooks(unittest.TestCase):
    def test_every_cell_runs(self):
        paths = sorted(FOLDER.glob("*.ipynb"))
        self.assertEqual(len(paths), 4)
        for path in paths:
            space = {"__name__": "notebook"}
            for number, cell in enumerate(json.loads(path.read_text())["cells"]):
                self.assertEqual(cell.get("outputs", []), [], f"{path.name}: kept without outputs")
                if cell["cell_type"] == "code":
                    exec(compile("".join(cell["source"]), f"{path.name}[{number}]", "exec"), space)


if __name__ == "__main__":
    unittest.main()
