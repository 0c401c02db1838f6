"""The decorator style: a sketch is a satellite whose parts are plain functions."""

from .sat import FlowSat


class Sketch(FlowSat):
    """A satellite made of functions:

        sketch = Sketch(interval=0.1)

        @sketch.setup
        def setup(): ...                       # once, when the hub has let it in

        @sketch.loop
        def loop(): ...                        # at each pulse

        @sketch.subscribe("robot.imu")
        def on_imu(message): print(message.value)

        @sketch.serve("gripper", doc="opens and closes")
        def gripper(request): return {"ok": True}

        @sketch.watch("arm", "gain.")
        def on_gain(variable): ...

        sketch.run()

    Each takes the arguments of `FlowSat`'s method of the same name. For each `on_` function of `FlowSat` there is a
    decorator without `on_`: `@sketch.lost`, `@sketch.channel`, `@sketch.refused` and so on.
    """

    def __init__(self, *arguments, **settings):
        FlowSat.__init__(self, *arguments, **settings)
        self._functions = {}

    def setup(self, function=None):
        """Decorator: called once."""
        return self._keep("setup", function) if function is not None else self._run("setup")

    def loop(self, function=None):
        """Decorator: called at each pulse."""
        return self._keep("loop", function) if function is not None else self._run("loop")

    def _keep(self, name, function):
        self._functions[name] = function
        return function

    def _run(self, name):
        function = self._functions.get(name)
        if function is not None:
            function()

    def subscribe(self, name, on_message=None, depth=0, policy="latest", on_batch=None):
        """Decorator, or with a function as `FlowSat.subscribe`."""
        if on_message is not None or on_batch is not None:
            return FlowSat.subscribe(self, name, on_message, depth, policy, on_batch)

        def decorate(function):
            FlowSat.subscribe(self, name, function, depth, policy)
            return function
        return decorate

    def batch(self, name, **wishes):
        """Decorator: hears a channel in batches, `function(channel, payloads)`."""
        def decorate(function):
            FlowSat.subscribe(self, name, on_batch=function, **wishes)
            return function
        return decorate

    def serve(self, name, answer=None, **properties):
        """Decorator, or with a function as `FlowSat.serve`."""
        if answer is not None:
            return FlowSat.serve(self, name, answer, **properties)

        def decorate(function):
            FlowSat.serve(self, name, function, **properties)
            return function
        return decorate

    def watch(self, database, prefix=""):
        """Decorator: hears of the variables of a database."""
        def decorate(function):
            self.database(database).watch(prefix, function)
            return function
        return decorate


def _decorator(name):
    def keep(self, function):
        setattr(self, "on_" + name, function)
        return function
    keep.__name__, keep.__doc__ = name, "Decorator: takes the place of `FlowSat.on_%s`." % name
    return keep


for _name in ("message", "header", "start", "dropped", "lost", "refused", "tick_report", "channel"):
    setattr(Sketch, _name, _decorator(_name))
# `stop` is what ends a sketch.
Sketch.unheard = _decorator("stop")
