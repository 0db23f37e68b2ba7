"""Results: runs folded from the journal, judged parts, their reports and exports. Controls nothing.

`run.load_run` folds a run's journal into a `RunRecord`; `judged.judged_parts` are its parts with
all data for a report, `judged.inspected` makes the same of an inspection without a run. `writing`
writes pages, PDF and the files of `exports`. `plan_page` and `sheet` draw a plan and compiled
parts. Each is imported by itself: who folds a run needs no page.
"""
