#!/bin/sh
# Compiles hand.cpp: build.sh VENV PROGRAM
#
# VENV is a virtual environment with the Python packages pin and cmeel-eigen, which bring the headers
# of Pinocchio and Eigen; one that does not exist is made. Prints what it was compiled with.
set -eu

venv=$1
program=$2
source=$(dirname "$0")/hand.cpp

if [ ! -d "$venv" ]; then
    rm -rf "$venv.new"
    python3 -m venv "$venv.new"
    "$venv.new/bin/pip" install --quiet --disable-pip-version-check --retries 1 --timeout 20 \
        pin cmeel-eigen >&2
    # Only a whole one has the name by which it is found.
    mv "$venv.new" "$venv"
fi

prefix=$(echo "$venv"/lib/python3*/site-packages/cmeel.prefix)
compiler=${CXX:-c++}
# As Pinocchio itself is compiled: it has more kinds of joints than the lists of Boost have room for.
boost="-DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30
    -DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_FUSION_INVOKE_MAX_ARITY=12"
flags="-std=c++17 -O3 -march=native -DNDEBUG"

if [ ! "$program" -nt "$source" ]; then
    # shellcheck disable=SC2086 # several flags
    "$compiler" $flags $boost -w -isystem "$prefix/include" -isystem "$prefix/include/eigen3" \
        "$source" -o "$program.new" -L "$prefix/lib" -Wl,-rpath,"$prefix/lib" >&2
    mv "$program.new" "$program"
fi
echo "$("$compiler" --version | head -n 1), $flags"
