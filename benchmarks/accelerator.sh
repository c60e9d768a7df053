#!/usr/bin/env bash
# All work for a machine with an accelerator, in parts of under 10 minutes each:
#   benchmarks/accelerator.sh speed | learning | train | study
# Needs JAX for the device; other packages that are missing come from wheels/, if that folder is
# there (fill it beforehand with: pip download --no-deps --dest wheels tyro jaxtyping ...).
# A study goes on each time where it stopped: on another machine from study.tar.gz, if it is there.
set -euo pipefail
cd "$(dirname "$0")/.."
if [ -d wheels ]; then pip install --quiet --no-index --find-links wheels --no-deps wheels/*.whl; fi
export PYTHONPATH=$PWD
out=${OUT:-runs}

study() {
  local status=0
  if [ ! -d runs/study ] && [ -f study.tar.gz ]; then tar xzf study.tar.gz; fi
  timeout --signal INT --kill-after 60 500 \
    python -m salpchain.cli.main reproduce --preset paper --seeds 3 --out runs/study || status=$?
  tar czf "$out/study.tar.gz" --exclude=cache --exclude=tensorboard runs/study
  case $status in 124|137) ;; *) exit "$status" ;; esac  # out of time is no failure
}

case "${1:-}" in
  speed) timeout 590 python -m benchmarks.run --ours --name gpu ;;
  learning) timeout 590 python -m benchmarks.learning --name gpu ;;
  train) timeout 590 python -m benchmarks.training --seeds 5 --runs "$out/benchmark" --name gpu ;;
  study) study ;;
  *) echo "usage: benchmarks/accelerator.sh speed|learning|train|study" >&2; exit 2 ;;
esac
