#!/usr/bin/env bash
# All work for a machine with an accelerator, in parts of under 10 minutes each, one at a time
# (iterations of three trainings that shared an H200 took ten times as long as alone):
#   benchmarks/accelerator.sh speed | learning | train | study | budget
# Needs JAX for the device; other packages that are missing come from wheels/, if that folder is
# there (fill it beforehand with: pip download --no-deps --dest wheels tyro jaxtyping ...).
# `study` and `budget` go on each time where they stopped: on another machine from study.tar.gz or
# budget.tar.gz, if it is there.
set -euo pipefail
cd "$(dirname "$0")/.."
export PYTHONPATH=$PWD
if [ -d wheels ]; then
  python3 -m pip install --quiet --no-index --no-deps --target runs/site wheels/*.whl
  PYTHONPATH=$PYTHONPATH:$PWD/runs/site
fi
out=${OUT:-runs}

# Runs a command for 500 s and packs the folder runs/$1, which it goes on with.
go_on() {
  local name=$1 status=0; shift
  if [ ! -d "runs/$name" ] && [ -f "$name.tar.gz" ]; then tar xzf "$name.tar.gz"; fi
  timeout --signal INT --kill-after 60 500 "$@" || status=$?
  tar czf "$out/$name.tar.gz" --exclude=cache --exclude=tensorboard "runs/$name"
  case $status in 124|137) ;; *) exit "$status" ;; esac  # out of time is no failure
}

case "${1:-}" in
  speed) timeout 590 python3 -m benchmarks.run --ours --name gpu --overwrite ;;
  learning) timeout 590 python3 -m benchmarks.learning --name gpu --overwrite ;;
  train) timeout 590 python3 -m benchmarks.training --seeds 5 --runs "$out/benchmark" --name gpu --overwrite ;;
  study) go_on study python3 -m salpchain.cli.main reproduce --preset paper --seeds 3 --out runs/study ;;
  budget) go_on budget python3 -m studies.budget.run runs/budget "ten times the steps" ;;
  *) echo "usage: benchmarks/accelerator.sh speed|learning|train|study|budget" >&2; exit 2 ;;
esac
