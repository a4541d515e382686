"""foretouch: feel what the remote robot touches before the network can tell you."""

__version__ = "0.1.0"
