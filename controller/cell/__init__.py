"""The cell itself: state machine, actions, journal, custody, interlocks."""
