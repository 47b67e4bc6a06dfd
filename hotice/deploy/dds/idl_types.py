"""The messages as DDS types, made from the same tables as the records; their bytes pass Cyclone unopened.

8-bit fields are `byte`, never `uint8`: the type is announced to every machine on the network, and a `uint8` where the
robot's own types have an octet makes programs on its version of Cyclone (0.10.2) crash when they hear of it
(eclipse-cyclonedds/cyclonedds#1554). The hashes of these types are equal to the vendor's, which the tests hold.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from hotice.deploy.dds.cyclone import cyclone
from hotice.deploy.messages.hg import NAMESPACE
from hotice.deploy.messages.structs import Struct

API = "unitree_api.msg.dds_"


class Packed:
    """What a sample is that carries its own bytes on the wire, header included; what comes in is not looked at here."""

    def __init__(self, data: bytes) -> None:
        self.data = bytes(data)

    def serialize(self, *_: Any, **__: Any) -> bytes:
        return self.data

    @classmethod
    def deserialize(cls, data: bytes, *_: Any, **__: Any) -> Packed:
        return cls(data)

    @classmethod
    def deserialize_key(cls, data: bytes, *_: Any, **__: Any) -> Packed:
        # these messages have no key: it comes when a writer ends, with nothing in it
        return cls(data)


@cache
def packed_type(struct: Struct) -> Any:
    """The DDS type of a message, whose samples are `Packed`. Raises `MissingExtra`."""
    return _made(struct.name, NAMESPACE, _fields(struct, plain_type), packed=True)


@cache
def plain_type(struct: Struct) -> Any:
    """The DDS type of a part of a message, and for tests of a whole one, as a dataclass of its fields."""
    return _made(struct.name, NAMESPACE, _fields(struct, plain_type))


@cache
def request_type(*, packed: bool = True) -> Any:
    """`unitree_api` Request, see `messages.rpc`; a dataclass if not packed."""
    types = cyclone().types
    identity = _identity()
    lease = _made("RequestLease_", API, {"id": types.int64})
    policy = _made("RequestPolicy_", API, {"priority": types.int32, "noreply": bool})
    header = _made("RequestHeader_", API, {"identity": identity, "lease": lease, "policy": policy})
    return _made("Request_", API, {"header": header, "parameter": str, "binary": types.sequence[types.byte]}, packed)


@cache
def response_type(*, packed: bool = True) -> Any:
    """`unitree_api` Response."""
    types = cyclone().types
    status = _made("ResponseStatus_", API, {"code": types.int32})
    header = _made("ResponseHeader_", API, {"identity": _identity(), "status": status})
    return _made("Response_", API, {"header": header, "data": str, "binary": types.sequence[types.byte]}, packed)


@cache
def _identity() -> Any:
    types = cyclone().types
    return _made("RequestIdentity_", API, {"id": types.int64, "api_id": types.int64})


def _fields(struct: Struct, part: Any) -> dict[str, Any]:
    types = cyclone().types
    scalars = {
        "u8": types.byte,
        "u16": types.uint16,
        "i16": types.int16,
        "u32": types.uint32,
        "i32": types.int32,
        "f32": types.float32,
    }
    fields = {}
    for field in struct.fields:
        kind = part(field.kind) if isinstance(field.kind, Struct) else scalars[field.kind]
        fields[field.name] = kind if field.count == 1 else types.array[kind, field.count]
    return fields


def _made(name: str, namespace: str, fields: dict[str, Any], packed: bool = False) -> Any:
    made = cyclone().idl.make_idl_struct(name, f"{namespace}.{name}", fields, dataclassify=not packed)
    if packed:
        # not by inheritance, which would announce a type with a base
        for method in ("__init__", "serialize", "deserialize", "deserialize_key"):
            setattr(made, method, Packed.__dict__[method])
    return made
