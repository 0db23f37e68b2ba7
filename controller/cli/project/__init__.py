"""A new project: recipe, cell file, part, script."""
