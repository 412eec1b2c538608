"""What goes over the wire: pydantic messages, and how they become bytes and arrays. Pydantic stops here."""

PROTOCOL_VERSION = 1
"""Version of the message schemas and of the key prefix ``zengrid/@v1``."""
