"""One module per command: its arguments, its help, and the call of what does the work.

A command imports its work when it is called, so that `cellctl --help` reads these modules alone.
"""
