#!/bin/sh
# Installs tcfit for a server: the steps of the Dockerfile, and of a server without Docker. Run it from a checkout.
#
#     deploy/install.sh SOURCE TARGET
#
# SOURCE: the checkout. TARGET: a folder for the environment, which must not exist yet.
set -eu

if [ $# -ne 2 ]; then
    echo "usage: $0 SOURCE TARGET" >&2
    exit 2
fi
source=$1 target=$2
if [ ! -f "$source/pyproject.toml" ] || [ ! -f "$source/constraints.txt" ]; then
    echo "$0: $source is no checkout of tcfit: it has no pyproject.toml and constraints.txt" >&2
    exit 2
fi
if [ -e "$target" ]; then
    echo "$0: $target is there already; remove it, or name another folder" >&2
    exit 2
fi

"${PYTHON:-python3}" -m venv "$target"
# torch without CUDA is a tenth of the size: TORCH_INDEX is the package index of PyTorch's CPU builds, see pytorch.org.
: "${TORCH_INDEX=}"
if [ -n "$TORCH_INDEX" ]; then
    version=$(sed -n 's/^torch==//p' "$source/constraints.txt")
    "$target/bin/pip" install --quiet --no-cache-dir --index-url "$TORCH_INDEX" "torch==$version"
fi
"$target/bin/pip" install --quiet --no-cache-dir --constraint "$source/constraints.txt" "$source"

# The solver's kernels, so that nobody waits for them at the first fit. From elsewhere: here Python would take the
# checkout, and not what was installed.
target=$(cd "$target" && pwd)
cd /
"$target/bin/python" -m fitting_core.fit.fused
# The detector's networks, without which keypoints cannot be found in videos. Running this agrees to their licence,
# which is printed. TCFIT_DOWNLOAD=no leaves them out.
if [ "${TCFIT_DOWNLOAD:-yes}" != no ]; then
    "$target/bin/tcfit" models add mediapipe --yes
fi
"$target/bin/tcfit" doctor
