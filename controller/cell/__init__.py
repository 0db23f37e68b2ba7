"""The cell itself: state machine, actions, journal, custody, interlocks.

`lock.py` keeps a second run out; whoever asks who has the cell loads no driver.
"""
