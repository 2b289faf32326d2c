"""Defines the messages between nodes: one dataclass per message, the topic table, the wire codec.

This package imports nothing else of the project, so that any tool can read the topics.
"""
