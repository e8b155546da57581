"""The home of many clips: a folder's projects, results and videos in one list, each opened, fitted and approved from
there. It is a page of its own beside viser's; what is opened is a review in this same process, at a path of its own, so
that torch and bodies are in memory once however many clips are looked at."""
