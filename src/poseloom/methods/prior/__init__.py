"""The learnt prior: a recurrent network that receives any subset of sensors and estimates the whole pose."""
