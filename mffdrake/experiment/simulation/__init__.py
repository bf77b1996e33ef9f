"""How is it run, judged and drawn?"""
