"""The models, one file each, and the arrays they see."""

# Every model by its name: the module, in this package, and the class.
MODELS = {
    "mixture_ppca": ".mixture_ppca:MixturePPCA",
    "multifactor": ".multifactor:Multifactor",
    "relevance_vector": ".relevance_vector:RelevanceVectors",
}
