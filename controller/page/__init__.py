"""The page: the cell in a browser, served by a process of its own (ADR 68).

It reads the journal and acts on the cell through its control socket. `app.py` lists the screens,
`frame` has their shared code, `security` the access control, `serving.py` the server. The extra
`page` installs its dependencies.

To add a screen, say *Review*:

1. a package `controller/page/review` with `templates/`, `static/` and, for texts of its own,
   `catalogues/de/LC_MESSAGES/page.po` (compiled by ``pybabel compile``, see `frame/words.py`);
2. in it, `screen(setting)`, which returns a `Screen` that lists its answers::

       def screen(setting: Setting) -> Screen:
           answers = ReviewAnswers(setting)
           return Screen("review", word("Review"), (
               Look("", answers.list),                                # GET /review
               Look("part/{number:int}", answers.part),               # GET /review/part/7
               Act("decide", DecideBody, answers.decide, Role.OPERATOR),  # POST, a JSON body
               Upload("file", 50_000_000, frozenset({".step"}), answers.take, Role.ENGINEER),
           ))

3. one line in `SCREENS` of `app.py`.

Every answer takes a `Visit` (user, language, `visit.html(...)`); an act gets its body as a model
besides, an upload the file. A refusal is a `RefusedError`, or `refused(...)`. Session, role,
origin, token of the session, size and form of the body are checked before the call. Its page
extends `screen.html.j2` (blocks `title`, `head`, `content`) and loads `/static/review/review.js`,
which imports `/static/shared.js`: `t()` translates a text, `post()` sends an act, `send()` a file.
Texts in Python that reach a person are marked with `word("...")`. Style within the HTML and scripts
within it are refused by the browser; so is a script from elsewhere.
"""
