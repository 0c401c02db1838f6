"""Databases of the hub: variables that outlive a moment, and sometimes the hub."""

from .clock import monotonic
from .connection import Refused
from .flow import Part
from .variant import unpack

# The name that stands for the flow's own database, whatever the hub calls the flow.
OWN = ""
WATCH_AGAIN_S = 1.0


class Variable(object):
    """A variable that a watch tells of: `value` is None and `deleted` true when it is gone."""

    __slots__ = ("key", "value", "deleted")

    def __init__(self, key, value=None, deleted=False):
        self.key, self.value, self.deleted = key, value, deleted

    def __repr__(self):
        return "<%s %s>" % (self.key, "deleted" if self.deleted else repr(self.value))


class Watch(object):
    """A watch of the variables whose keys begin with `prefix`. `values` are the newest ones, by key; `whole` is whether
    all that was there at the beginning has been told."""

    def __init__(self, database, prefix, then):
        self.prefix, self.values, self.whole, self.cancelled = prefix, {}, False, False
        self._database, self._then = database, then
        self._seen, self._told, self._tag = 0, set(), None

    @property
    def in_force(self):
        """Whether the hub tells changes just now."""
        return self._tag is not None

    def cancel(self):
        """Ends it."""
        self.cancelled = True
        self._database.forget(self)
        if self._tag is not None and self._database.flow.ready:
            self._database.flow.forget(self._tag)
            self._database.flow.command("unwatch", self._tag)

    # ---- for the database ----

    def begin(self):
        """Asks for it, from what was seen last on."""
        flow = self._database.flow
        self._told = set()
        self._tag = flow.ask(self._answered, "watch", self._database.full_name, self.prefix, self._seen, flow.form)

    def lost(self):
        """The hub is lost."""
        self._tag = None

    def _answered(self, answer):
        if isinstance(answer, Refused):
            # The database may come yet: that is tried now and then.
            self._tag = None
            if answer.code not in ("Lost", "NoSuchDatabase", "Gone"):
                self._database.flow.listener.on_refused(answer)
            return
        name, fields = answer
        if name == "watch_over":
            self._tag = None
        elif name == "watching":
            self._complete(fields[0], fields[1])
        elif name == "changed":
            self._changed(fields[0], Variable(fields[1], unpack(*fields[2])))
        elif name == "deleted":
            self._changed(fields[0], Variable(fields[1], deleted=True))

    def _changed(self, sequence, variable):
        if self._seen:
            self._seen = sequence
        if variable.deleted:
            if self.values.pop(variable.key, self) is not self:
                self._tell(variable)
            return
        self._told.add(variable.key)
        known = variable.key in self.values and self.values[variable.key] == variable.value
        self.values[variable.key] = variable.value
        if not known:
            self._tell(variable)

    def _complete(self, sequence, whole):
        told, self._told = self._told, set()
        self._seen = sequence
        if whole:
            for key in [key for key in self.values if key not in told]:
                del self.values[key]
                self._tell(Variable(key, deleted=True))
        self.whole = self.whole or sequence != 0

    def _tell(self, variable):
        if self._then is not None and not self.cancelled:
            self._then(variable)


class Database(object):
    """A database as a satellite uses it: what is asked is answered later, by the function `then`. Without a hub these
    raise `LinkError`; watches, and what was set in a satellite's own database, come back with it."""

    def __init__(self, clerk, flow, name):
        self.flow, self.name, self._clerk, self._watches = flow, name, clerk, []
        self._create = None

    @property
    def full_name(self):
        """Its name at the hub."""
        return self.name if self.name != OWN else "flow:%s" % (self.flow.name or "")

    def create(self, durable=False):
        """Creates it where it is missing, now and after each loss of the hub. Durable: each change goes to the disk."""
        self._create = durable
        if self.flow.ready:
            self._begin_create()
        return self

    def set(self, key, value, then=None):
        """Sets a variable. `then(error)` is called when the hub has done it (None), or refused it."""
        self._change(then, key, "var_set", key, self.flow.value(value))

    def delete(self, key, then=None):
        """Deletes a variable."""
        self._change(then, key, "var_delete", key)

    def get(self, key, then):
        """Asks for a variable: `then(value, error)`."""
        def told(answer):
            if isinstance(answer, Refused):
                return then(None, answer)
            then(unpack(*answer[1][0]), None)
        self._clerk.ask(self, told, key, "var_get", key, self.flow.form)

    def all(self, prefix, then):
        """Asks for the variables whose keys begin so: `then(dict, error)`."""
        found = {}

        def told(answer):
            if isinstance(answer, Refused):
                return then(None, answer)
            if answer[0] == "list_end":
                return then(found, None)
            found[answer[1][0]] = unpack(*answer[1][1])
        self._clerk.ask(self, told, prefix, "db_all", prefix, self.flow.form)

    def save(self, then=None):
        """Writes it to the disk as a whole: `then(error)` when it is there."""
        self._change(then, self.name, "db_save")

    def load(self, then=None):
        """Puts what was saved last in its place: `then(error)`."""
        self._change(then, self.name, "db_load")

    def watch(self, prefix="", then=None):
        """Hears of all variables whose keys begin with `prefix`, now and at each change: `then(variable)`. Answers the
        `Watch`."""
        watch = Watch(self, prefix, then)
        self._watches.append(watch)
        if self.flow.ready:
            watch.begin()
        return watch

    # ---- for the clerk and for watches ----

    def forget(self, watch):
        """A watch was cancelled."""
        if watch in self._watches:
            self._watches.remove(watch)

    def restore(self):
        """After a reconnection."""
        if self._create is not None:
            self._begin_create()
        self.begin_watches()

    def begin_watches(self):
        """Begins those that are not in force."""
        for watch in self._watches:
            if not watch.in_force:
                watch.begin()

    def lost(self):
        """The hub is lost."""
        for watch in self._watches:
            watch.lost()

    def _begin_create(self):
        def told(answer):
            if isinstance(answer, Refused) and answer.code not in ("Exists", "Lost"):
                self.flow.listener.on_refused(answer)
        self.flow.ask(told, "db_create", self.full_name, int(self._create), about=self.name)

    def _change(self, then, about, command, *values):
        def told(answer):
            error = answer if isinstance(answer, Refused) else None
            if then is not None:
                then(error)
            elif error is not None and error.code != "Lost":
                self.flow.listener.on_refused(error)
        self._clerk.ask(self, told, about, command, *values)


class Clerk(Part):
    """All databases that a satellite uses. Commands act on the connection's current database, so one for another is
    preceded by `db_select`; if that is refused, none is current and the command is refused too."""

    def __init__(self, flow):
        self._flow, self._databases, self._current, self._again_at = flow, {}, None, 0.0
        self._introduction = {}
        self.events = {"database_selected": self._on_selected}

    def database(self, name):
        """The database of this name."""
        if name not in self._databases:
            self._databases[name] = Database(self, self._flow, name)
        return self._databases[name]

    def ask(self, database, then, about, command, *values):
        """Sends a command about a database."""
        if self._current is not database:
            self._flow.ask(self._unless_selected(database), "db_select", database.full_name)
            self._current = database
        self._flow.ask(then, command, *values, about=about)

    def _unless_selected(self, database):
        def told(answer):
            if isinstance(answer, Refused) and self._current is database:
                self._current = None
        return told

    def introduce(self, key, value):
        """Keeps a variable in the flow's own database, from now on and on each connection to come."""
        self._introduction[key] = value
        if self._flow.ready:
            self._tell(key, value)

    def _tell(self, key, value):
        # An account may lack the right to databases: nobody asked for this, so nobody is told.
        self.ask(self.database(OWN), lambda _: None, key, "var_set", key, self._flow.value(value))

    def restore(self):
        # After a resumption the hub remembers a current database; to select it again costs less than to rely on it.
        self._current = None
        for key, value in self._introduction.items():
            self._tell(key, value)
        for database in list(self._databases.values()):
            database.restore()

    def lose(self, error):
        self._current = None
        for database in self._databases.values():
            database.lost()

    def check(self, now):
        if self._flow.ready and now >= self._again_at:
            self._again_at = monotonic() + WATCH_AGAIN_S
            for database in self._databases.values():
                database.begin_watches()

    def _on_selected(self, tag, _flags, fields):
        if tag == 0 and not fields[0]:
            self._current = None
