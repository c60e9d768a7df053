#!/usr/bin/env bash
# All work for a machine with an accelerator, in parts of under 10 minutes each:
#   benchmarks/accelerator.sh speed | train
# Needs JAX for the device; other packages that are missing come from wheels/, if that folder is
# there (fill it beforehand with: pip download --no-deps --dest wheels tyro jaxtyping ...).
set -euo pipefail
cd "$(dirname "$0")/.."
if [ -d wheels ]; then pip install --quiet --no-index --find-links wheels --no-deps wheels/*.whl; fi
export PYTHONPATH=$PWD
case "${1:-}" in
  speed) timeout 590 python -m benchmarks.run --ours --name gpu ;;
  train) timeout 590 python -m benchmarks.training --seeds 5 --runs "${OUT:-runs}/benchmark" --name gpu ;;
  *) echo "usage: benchmarks/accelerator.sh speed|train" >&2; exit 2 ;;
esac
