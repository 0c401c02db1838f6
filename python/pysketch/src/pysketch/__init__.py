"""PySketch: Python satellites for SpecialK hubs, in Python 2.7 and in 3.6 and later, without dependencies.

    from pysketch import Sketch

    sketch = Sketch(interval=0.1)

    @sketch.loop
    def loop():
        sketch.publish("celsius", 21.5)

    sketch.run()
"""

from .address import Address
from .blob import FileInfo, Files, Store
from .channels import ChannelInfo
from .connection import Closed, Refused
from .database import Database, Variable, Watch
from .frames import ProtocolError
from .links import LinkError
from .login import LoginError, Password, Peer, Token
from .sat import FlowSat
from .service import Reply, Request, Service
from .sketch import Sketch
from .streams import Stream
from .subscriptions import Message, Subscription
from .sync import SyncSource, TickReport
from .sync_connection import SyncConnection, connect
from .variant import Typed, VariantError

__version__ = "0.1.0"
__all__ = [
    "Address", "ChannelInfo", "Closed", "Database", "FileInfo", "Files", "FlowSat", "LinkError", "LoginError", "Message",
    "Password", "Peer", "ProtocolError", "Refused", "Reply", "Request", "Service", "Sketch", "Store", "Stream",
    "Subscription", "SyncConnection", "SyncSource", "TickReport", "Token", "Typed", "Variable", "VariantError", "Watch",
    "connect",
]
