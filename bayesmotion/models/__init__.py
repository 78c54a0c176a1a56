"""The models, one file each, and the arrays they see."""

# Every model by its name: the module, in this package, and the class.
MODELS = {
    "multifactor": ".multifactor:Multifactor",
    "tensor": ".multifactor_tensor:MultifactorTensor",
    "gait-pose": ".gait_pose:GaitPose",
    "mixture_ppca": ".mixture_ppca:MixturePPCA",
    "relevance_vector": ".relevance_vector:RelevanceVectors",
    "shared-gplvm": ".shared_gplvm:SharedGPLVM",
}
