"""Motions on the rigs of animators: Mixamo's, Unreal's mannequin, VRM, and the user's own by a mapping file."""
