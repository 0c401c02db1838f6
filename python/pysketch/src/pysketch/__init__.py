"""PySketch: Python satellites for SpecialK hubs, in Python 2.7 and in 3.6 and later, without dependencies.

    from pysketch import Sketch

    sketch = Sketch(interval=0.1)

    @sketch.loop
    def loop():
        sketch.publish("celsius", 21.5)

    sketch.run()
"""

from .connection import Closed, Refused
from .database import Database, Variable
from .frames import ProtocolError
from .links import Address, LinkError
from .login import LoginError, Password, Peer, Token
from .sat import ChannelInfo, FlowSat, Message, Stream
from .service import Reply, Request
from .sketch import Sketch
from .sync_connection import SyncConnection, connect
from .variant import Typed, VariantError

__version__ = "0.1.0"
__all__ = [
    "Address", "ChannelInfo", "Closed", "Database", "FlowSat", "LinkError", "LoginError", "Message", "Password",
    "Peer", "ProtocolError", "Refused", "Reply", "Request", "Sketch", "Stream", "SyncConnection", "Token", "Typed",
    "Variable", "VariantError", "connect",
]
