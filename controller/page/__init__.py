"""The page: what the cell does, in a browser, from a process of its own.

It reads the journal (`fold.py`, `live.py`) and acts on the cell through its control socket alone
(`routes.py`). `security` decides who may; `scene.py` draws, `words.py` has the languages,
`serving.py` serves. The extra `page` brings what it needs (ADR 68).
"""
