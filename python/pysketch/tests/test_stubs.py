"""The stubs say what is there, and nothing else."""

import ast
import inspect
import os
import sys
import unittest

import pysketch

FOLDER = os.path.dirname(os.path.abspath(pysketch.__file__))


@unittest.skipIf(sys.version_info < (3, 6), "stubs are in the syntax of Python 3")
class Stubs(unittest.TestCase):
    """Against the package itself."""

    def check(self, stub, module):
        with open(os.path.join(FOLDER, stub)) as file:
            nodes = [node for node in ast.parse(file.read()).body if isinstance(node, ast.ClassDef)]
        self.assertTrue(nodes)
        for node in nodes:
            found = getattr(module, node.name, None)
            if found is None:
                # A class that only appears as what a method answers.
                self.assertNotIn(node.name, getattr(module, "__all__", ()))
                continue
            for said in node.body:
                if isinstance(said, ast.FunctionDef):
                    self.check_function(node.name, said, inspect.getattr_static(found, said.name, None))

    def check_function(self, owner, said, there):
        name = "%s.%s" % (owner, said.name)
        self.assertIsNotNone(there, name)
        if isinstance(there, property) or inspect.isdatadescriptor(there):
            return self.assertTrue(said.decorator_list, name)
        if isinstance(there, classmethod):
            there = there.__func__
        wanted = list(inspect.signature(there).parameters.values())
        plain = [argument.arg for argument in said.args.args]
        self.assertEqual(plain, [one.name for one in wanted if one.kind == one.POSITIONAL_OR_KEYWORD][:len(plain)], name)

    def test_the_package_is_as_its_stub_says(self):
        self.check("__init__.pyi", pysketch)
        with open(os.path.join(FOLDER, "__init__.pyi")) as file:
            defined = set(node.name for node in ast.parse(file.read()).body if hasattr(node, "name"))
        self.assertEqual(set(pysketch.__all__) - defined, set())

    def test_what_users_call_is_in_the_stub(self):
        with open(os.path.join(FOLDER, "__init__.pyi")) as file:
            classes = dict((node.name, node) for node in ast.parse(file.read()).body if isinstance(node, ast.ClassDef))
        inner = {"SyncConnection": ("on_run", "on_event")}
        for name in ("FlowSat", "Sketch", "SyncConnection", "Message", "Reply", "Files"):
            said = set(node.name for node in classes[name].body if isinstance(node, ast.FunctionDef))
            said |= set(node.target.id for node in classes[name].body if isinstance(node, ast.AnnAssign))
            there = set(one for one in vars(getattr(pysketch, name)) if not one.startswith("_"))
            self.assertEqual(there - said - set(inner.get(name, ())), set(), name)

    def test_aio_is_as_its_stub_says(self):
        from pysketch import aio
        self.check("aio.pyi", aio)


if __name__ == "__main__":
    unittest.main()
