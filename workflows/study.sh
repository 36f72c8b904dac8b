#!/bin/sh
# Every run of a study by itself, one after the other, then the table: the plain loop that any batch system can do.
# Stop it whenever you like; started again it goes on.
#
#   sh workflows/study.sh STUDY.toml DIR
set -eu
study=$1 out=$2
failed=0
for run in $(pmr study "$study" --list); do
    pmr study "$study" --out "$out" --jobs 1 --only "$run" || failed=1
done
pmr study "$study" --out "$out" || failed=1
exit $failed
