"""Which options are there, and what do they mean?"""
