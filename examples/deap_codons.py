"""Grammatical evolution by DEAP: its individuals are lists of codons, a whole population is evaluated at once."""

import random

from deap import algorithms, base, creator, tools

import harness


def main(population=200, generations=20, episodes=200):
    evaluate = harness.Evaluator("rocksample-7x8", "rocksample-feedback", episodes=episodes)
    creator.create("Return", base.Fitness, weights=(1.0,))
    creator.create("Codons", list, fitness=creator.Return)

    toolbox = base.Toolbox()
    toolbox.register("codon", random.randrange, 256)
    toolbox.register("individual", tools.initRepeat, creator.Codons, toolbox.codon, 60)
    toolbox.register("mate", tools.cxTwoPoint)
    toolbox.register("mutate", tools.mutUniformInt, low=0, up=255, indpb=0.03)
    toolbox.register("select", tools.selTournament, tournsize=3)
    toolbox.register("evaluate", lambda individuals: [(fitness,) for fitness in evaluate(individuals)])
    toolbox.register("map", lambda function, individuals: function(list(individuals)))  # all in one call

    random.seed(1)
    best = tools.HallOfFame(1)
    individuals = [toolbox.individual() for _ in range(population)]
    algorithms.eaSimple(individuals, toolbox, 0.8, 0.3, generations, halloffame=best, verbose=False)
    return evaluate.text(best[0]), best[0].fitness.values[0]


if __name__ == "__main__":
    program, fitness = main()
    print(program)
    print(f"fitness {fitness:.2f}; score it on episodes that it was not chosen by: harness evaluate")
