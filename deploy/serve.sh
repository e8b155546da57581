#!/bin/sh
# Serves one project, the projects of several people of one clip, or the list of all, behind the gate: what the
# container runs.
#
# TCFIT_PROJECT   folder of the project or projects, below TCFIT_PROJECTS; "." for the list of all
# TCFIT_PROJECTS  folder of all projects; pages may name its files, and no others (default: /projects)
# TCFIT_PUBLIC    address under which the proxy offers it, such as https://fits.example.org (default: none)
# TCFIT_PASSWORD_FILE  file with the password (default: none; each browser then needs a link, which is in the log)
# TCFIT_NETWORKS  folder with the image's networks, which are copied to the user's data (default: none)
# TCFIT_ADDRESS   address of this computer that is listened on (default: 0.0.0.0, all of them)
# TCFIT_PORT      (default: 8080)
set -eu

projects=${TCFIT_PROJECTS:-/projects}
if [ -z "${TCFIT_PROJECT:-}" ]; then
    echo "TCFIT_PROJECT is not set: name the folder of a project in $projects" >&2
    exit 2
fi
project=$projects/$TCFIT_PROJECT
if [ "$TCFIT_PROJECT" != . ] && [ ! -f "$project/project.sqlite" ] && [ ! -f "$project/people.json" ]; then
    echo "There is no project at $project: make one with tcfit new VIDEO --keypoints KEYPOINTS --out $project" >&2
    exit 2
fi

if [ -n "${TCFIT_NETWORKS:-}" ]; then
    # The data volume may be of an earlier image, whose networks were others.
    cp -R "$TCFIT_NETWORKS/." "${XDG_DATA_HOME:?names the folder of the data}/"
fi

set -- review "$project" --host "${TCFIT_ADDRESS:-0.0.0.0}" --port "${TCFIT_PORT:-8080}" --no-browser --files "$projects"
[ -z "${TCFIT_PUBLIC:-}" ] || set -- "$@" --public "$TCFIT_PUBLIC"
[ -z "${TCFIT_PASSWORD_FILE:-}" ] || set -- "$@" --password-file "$TCFIT_PASSWORD_FILE"
exec tcfit "$@"
