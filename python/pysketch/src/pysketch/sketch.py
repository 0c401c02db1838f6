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

    Each takes the arguments of `FlowSat`'s method of the same name.
    """

    def __init__(self, *arguments, **settings):
        FlowSat.__init__(self, *arguments, **settings)
        self._functions = {}

    def _keep(self, name, function):
        self._functions[name] = function
        return function

    def _run(self, name, *arguments):
        function = self._functions.get(name)
        if function is not None:
            function(*arguments)

    def setup(self, function=None):
        """Decorator: called once."""
        return self._run("setup") if function is None else self._keep("setup", function)

    def loop(self, function=None):
        """Decorator: called at each pulse."""
        return self._run("loop") if function is None else self._keep("loop", function)

    def lost(self, function):
        """Decorator: called with the reason when the hub is lost."""
        return self._keep("lost", function)

    def channel(self, function):
        """Decorator: called with a channel and whether it exists, at each that comes or goes."""
        return self._keep("channel", function)

    def subscribe(self, name, on_message=None, **wishes):
        """Decorator, or with a function as `FlowSat.subscribe`."""
        if on_message is not None:
            return FlowSat.subscribe(self, name, on_message, **wishes)

        def decorate(function):
            FlowSat.subscribe(self, name, function, **wishes)
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

    def on_lost(self, why):
        """For the satellite."""
        self._run("lost", why)

    def on_channel(self, channel, exists):
        """For the satellite."""
        self._run("channel", channel, exists)
