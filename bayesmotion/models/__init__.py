"""The models of the collection, and the arrays they see."""
