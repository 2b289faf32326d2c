"""The environment join: one message of all environments for the messages that several devices make of their shares."""
