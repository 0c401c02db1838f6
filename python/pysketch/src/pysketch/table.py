# Made from the hub's command table by its tests; do not edit by hand.
"""What the flow protocol's commands, events and codes are: names, numbers and layouts."""

# name: (kind, comes in fragments, states, fields after the tag as (name, type))
COMMANDS = {
    "hello": (0x01, False, ("greeting",), (
        ("magic", "8 bytes"),
        ("version", "u16"),
        ("version_oldest", "u16"),
        ("fragment_bytes", "u32"),
        ("message_bytes", "u32"),
        ("nonce", "32 bytes"),
    )),
    "login_token": (0x02, False, ("login",), (
        ("proof", "32 bytes"),
    )),
    "login_peer": (0x03, False, ("login",), ()),
    "ping": (0x04, False, ("synchronous", "flow",), ()),
    "pong": (0x05, False, ("synchronous", "flow",), ()),
    "set_async": (0x06, False, ("synchronous",), (
        ("name", "string"),
        ("session", "16 bytes"),
        ("form", "form"),
    )),
    "list_channels": (0x07, False, ("synchronous", "flow",), (
        ("form", "form"),
    )),
    "login_scram": (0x08, False, ("login",), (
        ("message", "string"),
    )),
    "login_scram_proof": (0x09, False, ("login",), (
        ("message", "string"),
    )),
    "inspect": (0x0a, False, ("synchronous", "flow",), (
        ("subject", "string"),
        ("form", "form"),
    )),
    "udp_open": (0x0b, False, ("flow",), ()),
    "create_stream": (0x10, False, ("flow",), (
        ("name", "string"),
        ("properties", "value"),
    )),
    "remove_channel": (0x11, False, ("flow",), (
        ("channel", "channel"),
    )),
    "subscribe": (0x12, False, ("flow",), (
        ("channel", "channel"),
        ("policy", "policy"),
        ("depth", "u16"),
        ("divisor", "u8"),
    )),
    "unsubscribe": (0x13, False, ("flow",), (
        ("channel", "channel"),
    )),
    "publish": (0x14, True, ("flow",), (
        ("channel", "channel"),
        ("message", "u32"),
        ("payload", "payload"),
    )),
    "change_header": (0x15, False, ("flow",), (
        ("channel", "channel"),
        ("properties", "value"),
    )),
    "attach": (0x16, False, ("flow",), (
        ("replica", "channel"),
        ("source", "channel"),
    )),
    "detach": (0x17, False, ("flow",), (
        ("replica", "channel"),
    )),
    "poll_register": (0x18, False, ("synchronous",), (
        ("channel", "channel"),
    )),
    "poll_deregister": (0x19, False, ("synchronous",), (
        ("channel", "channel"),
    )),
    "poll": (0x1a, False, ("synchronous",), (
        ("channel", "channel"),
    )),
    "create_sync": (0x1b, False, ("flow",), (
        ("name", "string"),
        ("properties", "value"),
    )),
    "sync_tick": (0x1c, False, ("flow",), (
        ("channel", "channel"),
        ("sequence", "u64"),
    )),
    "tick_done": (0x1d, False, ("flow",), (
        ("channel", "channel"),
        ("sequence", "u64"),
    )),
    "create_service": (0x20, False, ("flow",), (
        ("name", "string"),
        ("properties", "value"),
    )),
    "call": (0x21, True, ("synchronous", "flow",), (
        ("channel", "channel"),
        ("deadline_ms", "u32"),
        ("payload", "payload"),
    )),
    "answer": (0x22, True, ("flow",), (
        ("request", "u64"),
        ("more", "u8"),
        ("payload", "payload"),
    )),
    "decline": (0x23, False, ("flow",), (
        ("request", "u64"),
        ("text", "string"),
    )),
    "cancel": (0x24, False, ("flow",), (
        ("call", "u32"),
    )),
    "create_blob": (0x30, False, ("flow",), (
        ("name", "string"),
        ("properties", "value"),
    )),
    "blob_begin": (0x31, False, ("flow",), (
        ("channel", "channel"),
        ("path", "path"),
        ("bytes", "u64"),
        ("checksum", "u32"),
    )),
    "blob_write": (0x32, True, ("flow",), (
        ("channel", "channel"),
        ("path", "path"),
        ("offset", "u64"),
        ("payload", "payload"),
    )),
    "blob_commit": (0x33, False, ("flow",), (
        ("channel", "channel"),
        ("path", "path"),
    )),
    "blob_abort": (0x34, False, ("flow",), (
        ("channel", "channel"),
        ("path", "path"),
    )),
    "blob_mkdir": (0x35, False, ("flow",), (
        ("channel", "channel"),
        ("path", "path"),
    )),
    "blob_move": (0x36, False, ("flow",), (
        ("channel", "channel"),
        ("from", "path"),
        ("to", "path"),
    )),
    "blob_remove": (0x37, False, ("flow",), (
        ("channel", "channel"),
        ("path", "path"),
    )),
    "blob_list": (0x38, False, ("synchronous", "flow",), (
        ("channel", "channel"),
        ("path", "path"),
    )),
    "blob_stat": (0x39, False, ("synchronous", "flow",), (
        ("channel", "channel"),
        ("path", "path"),
    )),
    "blob_read": (0x3a, False, ("synchronous", "flow",), (
        ("channel", "channel"),
        ("path", "path"),
        ("offset", "u64"),
        ("bytes", "u32"),
    )),
    "db_select": (0x40, False, ("synchronous", "flow",), (
        ("database", "string"),
    )),
    "db_create": (0x41, False, ("synchronous", "flow",), (
        ("database", "string"),
        ("durable", "u8"),
    )),
    "db_exists": (0x42, False, ("synchronous", "flow",), (
        ("database", "string"),
    )),
    "db_remove": (0x43, False, ("synchronous", "flow",), (
        ("database", "string"),
    )),
    "db_save": (0x44, False, ("synchronous", "flow",), ()),
    "db_load": (0x45, False, ("synchronous", "flow",), ()),
    "db_list": (0x46, False, ("synchronous", "flow",), (
        ("prefix", "string"),
    )),
    "var_set": (0x47, False, ("synchronous", "flow",), (
        ("key", "string"),
        ("value", "value"),
    )),
    "var_get": (0x48, False, ("synchronous", "flow",), (
        ("key", "string"),
        ("form", "form"),
    )),
    "var_has": (0x49, False, ("synchronous", "flow",), (
        ("key", "string"),
    )),
    "var_delete": (0x4a, False, ("synchronous", "flow",), (
        ("key", "string"),
    )),
    "db_keys": (0x4b, False, ("synchronous", "flow",), (
        ("prefix", "string"),
    )),
    "db_all": (0x4c, False, ("synchronous", "flow",), (
        ("prefix", "string"),
        ("form", "form"),
    )),
    "watch": (0x4d, False, ("flow",), (
        ("database", "string"),
        ("prefix", "string"),
        ("after", "u64"),
        ("form", "form"),
    )),
    "unwatch": (0x4e, False, ("flow",), (
        ("watch", "u32"),
    )),
    "user_set": (0x60, False, ("synchronous", "flow",), (
        ("user", "string"),
        ("rounds", "u32"),
        ("salt", "16 bytes"),
        ("stored_key", "32 bytes"),
        ("server_key", "32 bytes"),
    )),
    "user_remove": (0x61, False, ("synchronous", "flow",), (
        ("user", "string"),
    )),
    "user_list": (0x62, False, ("synchronous", "flow",), ()),
}

# name: (kind, comes in fragments, states, fields after the tag as (name, type))
EVENTS = {
    "welcome": (0x81, False, ("greeting",), (
        ("magic", "8 bytes"),
        ("version", "u16"),
        ("fragment_bytes", "u32"),
        ("message_bytes", "u32"),
        ("nonce", "32 bytes"),
    )),
    "logged_in": (0x82, False, ("login",), (
        ("connection", "u64"),
        ("user", "string"),
        ("proof", "32 bytes"),
    )),
    "ping": (0x83, False, ("synchronous", "flow",), ()),
    "pong": (0x84, False, ("synchronous", "flow",), ()),
    "scram_challenge": (0x85, False, ("login",), (
        ("message", "string"),
    )),
    "flow_begun": (0x86, False, ("synchronous",), (
        ("channels", "u32"),
        ("name", "string"),
        ("session", "16 bytes"),
        ("resumed", "u8"),
    )),
    "channel_listed": (0x87, False, ("synchronous", "flow",), (
        ("channel", "channel"),
        ("kind", "kind of channel"),
        ("hash", "u64"),
        ("owner", "u64"),
        ("name", "string"),
        ("properties", "value"),
    )),
    "list_end": (0x88, False, ("synchronous", "flow",), (
        ("count", "u32"),
    )),
    "done": (0x89, False, ("synchronous", "flow",), ()),
    "saved": (0x8a, False, ("synchronous", "flow",), ()),
    "flag": (0x8b, False, ("synchronous", "flow",), (
        ("value", "u8"),
    )),
    "value": (0x8c, False, ("synchronous", "flow",), (
        ("value", "value"),
    )),
    "udp_opened": (0x8d, False, ("flow",), (
        ("session", "u64"),
        ("key", "32 bytes"),
        ("port", "u16"),
    )),
    "channel_added": (0x90, False, ("synchronous", "flow",), (
        ("channel", "channel"),
        ("kind", "kind of channel"),
        ("hash", "u64"),
        ("owner", "u64"),
        ("name", "string"),
        ("properties", "value"),
    )),
    "channel_removed": (0x91, False, ("synchronous", "flow",), (
        ("channel", "channel"),
    )),
    "start_publishing": (0x92, False, ("flow",), (
        ("channel", "channel"),
    )),
    "stop_publishing": (0x93, False, ("flow",), (
        ("channel", "channel"),
    )),
    "data": (0x94, True, ("flow",), (
        ("channel", "channel"),
        ("message", "u32"),
        ("payload", "payload"),
    )),
    "dropped": (0x95, False, ("flow",), (
        ("channel", "channel"),
        ("reason", "u8"),
        ("total", "u64"),
    )),
    "subscribed": (0x96, False, ("flow",), (
        ("channel", "channel"),
    )),
    "unsubscribed": (0x97, False, ("flow",), (
        ("channel", "channel"),
    )),
    "header_changed": (0x98, False, ("synchronous", "flow",), (
        ("channel", "channel"),
        ("properties", "value"),
    )),
    "attached": (0x99, False, ("flow",), (
        ("replica", "channel"),
        ("source", "channel"),
    )),
    "detached": (0x9a, False, ("flow",), (
        ("replica", "channel"),
        ("source", "channel"),
    )),
    "latest": (0x9b, True, ("synchronous",), (
        ("channel", "channel"),
        ("message", "u32"),
        ("payload", "payload"),
    )),
    "credit": (0x9c, False, ("flow",), (
        ("channel", "channel"),
        ("bytes", "u64"),
    )),
    "tick": (0x9d, False, ("flow",), (
        ("channel", "channel"),
        ("sequence", "u64"),
    )),
    "tick_report": (0x9e, False, ("flow",), (
        ("channel", "channel"),
        ("target", "u64"),
        ("lag_ns", "u64"),
        ("done", "u64"),
        ("missed", "u64"),
        ("divisor", "u8"),
    )),
    "owner_changed": (0x9f, False, ("synchronous", "flow",), (
        ("channel", "channel"),
        ("owner", "u64"),
    )),
    "request": (0xa0, True, ("flow",), (
        ("channel", "channel"),
        ("request", "u64"),
        ("asker", "u64"),
        ("payload", "payload"),
    )),
    "request_over": (0xa1, False, ("flow",), (
        ("request", "u64"),
    )),
    "reply": (0xa2, True, ("synchronous", "flow",), (
        ("more", "u8"),
        ("payload", "payload"),
    )),
    "blob_resume": (0xb0, False, ("flow",), (
        ("offset", "u64"),
    )),
    "blob_listed": (0xb1, False, ("synchronous", "flow",), (
        ("name", "string"),
        ("directory", "u8"),
        ("bytes", "u64"),
    )),
    "blob_entry": (0xb2, False, ("synchronous", "flow",), (
        ("directory", "u8"),
        ("bytes", "u64"),
        ("checksum", "u32"),
    )),
    "blob_data": (0xb3, True, ("synchronous", "flow",), (
        ("payload", "payload"),
    )),
    "database_selected": (0xc0, False, ("synchronous", "flow",), (
        ("database", "string"),
    )),
    "database_listed": (0xc1, False, ("synchronous", "flow",), (
        ("database", "string"),
        ("durable", "u8"),
        ("variables", "u32"),
        ("bytes", "u64"),
    )),
    "key_listed": (0xc2, False, ("synchronous", "flow",), (
        ("key", "string"),
    )),
    "variable": (0xc3, False, ("synchronous", "flow",), (
        ("key", "string"),
        ("value", "value"),
    )),
    "changed": (0xc4, False, ("flow",), (
        ("sequence", "u64"),
        ("key", "string"),
        ("value", "value"),
    )),
    "deleted": (0xc5, False, ("flow",), (
        ("sequence", "u64"),
        ("key", "string"),
    )),
    "watching": (0xc6, False, ("flow",), (
        ("sequence", "u64"),
        ("whole", "u8"),
    )),
    "watch_over": (0xc7, False, ("flow",), ()),
    "user_listed": (0xe0, False, ("synchronous", "flow",), (
        ("user", "string"),
        ("connections", "u32"),
    )),
    "refused": (0xf0, False, ("synchronous", "flow",), (
        ("code", "u16"),
        ("text", "string"),
    )),
    "closing": (0xf1, False, ("greeting", "login", "synchronous", "flow",), (
        ("reason", "u16"),
        ("text", "string"),
    )),
}

REFUSALS = {
    1: "Denied",
    2: "Exists",
    3: "Gone",
    4: "NotOwner",
    5: "BadName",
    6: "TooManyChannels",
    7: "TooManySubscriptions",
    8: "NoFreeChannel",
    9: "Full",
    10: "BadProperties",
    11: "NotOffered",
    12: "WrongKind",
    13: "NoSuchService",
    14: "OwnerGone",
    15: "NoAnswer",
    16: "Declined",
    17: "TooManyRequests",
    18: "NothingYet",
    19: "NotRegistered",
    20: "Cycle",
    21: "Attached",
    22: "NoDatabase",
    23: "NoSuchDatabase",
    24: "NoSuchVariable",
    25: "BadKey",
    26: "DatabaseFull",
    27: "TooManyDatabases",
    28: "TooLong",
    29: "TooManyWatches",
    30: "BadPath",
    31: "NoSuchPath",
    32: "WrongPath",
    33: "NotEmpty",
    34: "BadChecksum",
    35: "BadOffset",
    36: "Quota",
    37: "Storage",
    38: "NoSuchUser",
    39: "BadUser",
    40: "NoSuchSubject",
}

CLOSINGS = {
    1: "Silent",
    2: "Shutdown",
    3: "Version",
    4: "LoginFailed",
    5: "ControlFull",
    6: "Crowded",
    7: "Replaced",
    8: "QueueFull",
    9: "AccountRemoved",
}

DROPS = {
    0: "Full",
    1: "NewestWins",
    2: "Gone",
    3: "Aborted",
    4: "Shutdown",
    5: "Rights",
    6: "Credit",
}

KINDS = {
    0: "stream",
    1: "service",
    2: "blob",
    3: "sync",
}

POLICIES = {
    0: "latest",
    1: "all",
}

MAGIC = b"SpecialK"
VERSION = 1
VERSION_OLDEST = 1
FRAGMENT_BYTES_MAX = 65536
MESSAGE_BYTES_MAX = 16777216
CONNECTION_BYTES_MAX = 33554432
DEPTH_MAX = 1024
PING_AFTER_S = 2
SILENCE_MAX_S = 6
LOGIN_TIME_MAX_S = 2
