"""Trains the learnt prior (`poseloom.methods.prior`): shards of motions, virtual sensors on tensors, losses, loop."""
