"""Speed against error of all Fresnel models: `run` measures, `tables` and `figures` show.

`candidates` are the models, compared with `answers` of their own before anything is timed; `pareto`
says which of them nothing beats, `verdicts` says it in `words`.
"""
