"""Databases of the hub: variables that outlive a moment, and sometimes the hub."""

from .connection import Refused
from .variant import BINARY, pack, unpack


class Variable(object):
    """A variable that a watch tells of: `value` is None and `deleted` true when it is gone."""

    __slots__ = ("key", "value", "deleted")

    def __init__(self, key, value=None, deleted=False):
        self.key, self.value, self.deleted = key, value, deleted

    def __repr__(self):
        return "<%s %s>" % (self.key, "deleted" if self.deleted else repr(self.value))


class _Watch(object):
    def __init__(self, database, prefix, then):
        self.database, self.prefix, self.then = database, prefix, then
        self.sequence, self.tag = 0, None

    def begin(self):
        satellite = self.database.satellite
        self.tag = satellite._ask_then(self.told, "watch", self.database.name, self.prefix, self.sequence, BINARY)

    def told(self, answer):
        if isinstance(answer, Refused):
            return self.database.satellite.on_refused(answer)
        name, fields = answer
        self.sequence = max(self.sequence, fields[0]) if fields else self.sequence
        if name == "changed":
            self.then(Variable(fields[1], unpack(*fields[2])))
        elif name == "deleted":
            self.then(Variable(fields[1], deleted=True))


class Database(object):
    """A database as a satellite uses it. What is asked is answered later, by the function `then`."""

    def __init__(self, satellite, name):
        self.satellite, self.name, self._watches = satellite, name, []

    def set(self, key, value, then=None):
        """Sets a variable. `then(error)` is called when the hub has done it (None), or refused it."""
        self._ask(then and (lambda answer: then(answer if isinstance(answer, Refused) else None)),
                  "var_set", key, (BINARY, pack(value, BINARY)))

    def delete(self, key, then=None):
        """Deletes a variable."""
        self._ask(then and (lambda answer: then(answer if isinstance(answer, Refused) else None)), "var_delete", key)

    def get(self, key, then):
        """Asks for a variable: `then(value, error)`."""
        def told(answer):
            if isinstance(answer, Refused):
                return then(None, answer)
            then(unpack(*answer[1][0]), None)
        self._ask(told, "var_get", key, BINARY)

    def watch(self, prefix, then):
        """Hears of all variables whose keys begin with `prefix`, now and at each change: `then(variable)`."""
        watch = _Watch(self, prefix, then)
        self._watches.append(watch)
        if self.satellite.ready:
            watch.begin()

    def restore(self):
        """For the satellite: after a reconnection."""
        for watch in self._watches:
            watch.begin()

    def _ask(self, then, command, *values):
        satellite = self.satellite
        # Commands of one connection are done in order: the one that selects the database comes first.
        satellite._ask("db_select", self.name)
        if then is None:
            satellite._ask(command, *values)
        else:
            satellite._ask_then(then, command, *values)
