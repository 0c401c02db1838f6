"""One file that is the whole package, for a robot without a package manager."""

import os
import re

# Those that need the names of the package itself, and the package before them.
_LAST = ("__init__", "aio", "__main__")
_HEAD = '''# -*- coding: utf-8 -*-
# PySketch {version} in one file, made by `python -m pysketch bundle`. Copy it beside your sketch and `import pysketch`, or
# run it: `python pysketch.py check`. Python 2.7, and 3.6 and later.
import linecache
import os
import sys
import types

_SOURCES = [
'''
_TAIL = ''']


def _load():
    package = sys.modules["pysketch"] = sys.modules[__name__]
    package.__path__, package.__package__ = [], "pysketch"
    folder = os.path.join(os.path.dirname(os.path.abspath(__file__)), "pysketch")
    for name, source in _SOURCES:
        if name == "aio" and sys.version_info[0] == 2:
            continue
        path = os.path.join(folder, name + ".py")
        linecache.cache[path] = (len(source), None, source.splitlines(True), path)
        if name == "__init__":
            module = package
        else:
            module = sys.modules["pysketch." + name] = types.ModuleType("pysketch." + name)
            module.__package__, module.__file__ = "pysketch", path
        exec(compile(source, path, "exec"), module.__dict__)
        if name != "__init__":
            setattr(package, name, module)


_run = __name__ == "__main__"
_load()
if _run:
    sys.exit(sys.modules["pysketch.__main__"].main())
'''


def sources(folder):
    """The modules of the package as (name, text), each after those that it imports."""
    texts = {}
    for file in os.listdir(folder):
        if file.endswith(".py"):
            with open(os.path.join(folder, file), "rb") as opened:
                texts[file[:-3]] = opened.read().decode("utf-8")
    done = []

    def add(name):
        if name in done:
            return
        # Imports inside of functions come when everything is there.
        for line in re.findall(r"^from \.(\w*) import (.*)", texts[name], re.MULTILINE):
            for needed in [line[0]] if line[0] else re.split(r"[ ,]+", line[1]):
                if needed in texts and needed != name:
                    add(needed)
        done.append(name)
    for name in sorted(set(texts) - set(_LAST)):
        add(name)
    done.extend(_LAST)
    return [(name, texts[name]) for name in done]


def bundle(version):
    """The text of the file."""
    parts = [_HEAD.format(version=version)]
    for name, text in sources(os.path.dirname(os.path.abspath(__file__))):
        text.encode("ascii")
        quoted = text.replace("\\", "\\\\").replace("'''", "\\'\\'\\'")
        parts.append("(%r, '''%s''')," % (str(name), quoted) + "\n\n")
    parts.append(_TAIL)
    return str("".join(parts))
