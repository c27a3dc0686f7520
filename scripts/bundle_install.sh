#!/bin/sh
# Install simwarp from this folder; nothing is fetched from a network. `sh install.sh --help` lists the options.
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd) || exit 1
wanted=$(sed -n 's/.*"python": *"\([0-9.]*\)".*/\1/p' "$here/bundle.json" 2>/dev/null)
if [ -z "$wanted" ]; then
    echo "install: bundle.json is missing or damaged; bring it again" >&2
    exit 1
fi
for python in ${PYTHON:+"$PYTHON"} "python$wanted" python3 python; do
    found=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
    [ "$found" = "$wanted" ] && exec "$python" "$here/install.py" "$@"
    # One that was named is not passed over.
    [ -n "$PYTHON" ] && break
done
echo "install: the bundle is for Python $wanted, and ${PYTHON:-this machine} has ${found:-none}; name one in PYTHON=/path/to/python$wanted, or write a bundle with --python" >&2
exit 2
