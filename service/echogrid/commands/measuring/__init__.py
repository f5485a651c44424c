"""How long does each part take on this machine?"""
