"""All people of a clip: tracked, rejoined after absences, with their uncertain frames."""
