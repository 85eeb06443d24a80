#!/bin/sh
# Makes the simulated recordings of this folder again: the paper's girder under one inspection car at 60 km/h, or under
# its 16-car train at 270 km/h, through a recorder of 200 samples a second with a 40 Hz low-pass.
set -eu
cd "$(dirname "$0")"
cargo build --quiet --release --package host-sim
recorded() {
    name=$1
    shift
    cargo run --quiet --release --package host-sim -- simulate --bridge girder50 --rate-hz 200 --antialias-hz 40 "$@" \
        -o "$name.csv"
}
simulate() {
    recorded "$@" --train inspection-2dof --cars 1 --speed-kmh 60
}

# As the paper does: made by the solver that will explain them, without noise.
simulate healthy-60kmh
simulate case1-60kmh --damage 5=0.11
simulate case4-60kmh --damage 1=0.21 --damage 5=0.41

# Nearer to a measurement: more modes and half the step, so that the solver that explains them is not the one that made
# them, and 5 % noise.
measured() {
    simulate "$@" --modes 12 --step-s 0.0005 --noise 0.05
}
measured healthy-60kmh-noise5-3nodes --nodes 3,6,9 --seed 2
measured case4-60kmh-noise5 --damage 1=0.21 --damage 5=0.41
measured case4-60kmh-noise5-3nodes --damage 1=0.21 --damage 5=0.41 --nodes 3,6,9 --seed 3

# The case that the paper could not solve: sixteen of its 15-DOF cars at 270 km/h.
recorded case8-3d-270kmh-noise2-3nodes --train shinkansen-3d --cars 16 --speed-kmh 270 --damage 5=0.11 --nodes 3,6,9 \
    --modes 12 --step-s 0.0005 --noise 0.02 --seed 8
