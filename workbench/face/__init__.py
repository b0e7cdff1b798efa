"""What `import workbench as wb` offers: each task as one function, and how its result is shown.

One module a task: the function, which takes paths as well as records and chooses the usual values, and the view of
its result, which binds the reports' tables and figures to it. `view` finds the view of a record.
"""
