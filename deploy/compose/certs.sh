# Makes certificates, and gives each service its own in a folder of its own: sh certs.sh [OPTION OF zengrid certs]...
# What is there stays: a later run adds, renews or revokes what its options say, and hands out again. See secure.yml.
set -eu
folder=${ZENGRID_CERTS_OUT:-/certs}
owner=${ZENGRID_CERTS_OWNER:-10001:10001}
authority=$folder/authority

if [ -e "$authority/access.json" ]; then
    zengrid certs "$authority" "$@"
else
    zengrid certs "$authority" --host clock --ids p1,p2,p3 --spare 20 "$@"
fi

# give FOLDER FILE...: copies, which only the service can read. A file is replaced at once or not at all.
give() {
    to=$folder/$1
    shift
    mkdir -p "$to"
    for file in ca.pem "$@"; do
        rm -f "$to/$file.new"
        cp "$authority/$file" "$to/$file.new"
        chmod 600 "$to/$file.new"
        chown "$owner" "$to/$file.new"
        mv -f "$to/$file.new" "$to/$file"
    done
}

# The clock's container also has the operator's, for its health check and for zengrid control.
give clock clock.pem clock.key access.json operator.pem operator.key
give gateway gateway.pem gateway.key
for name in grid p1 p2 p3; do
    give "$name" "$name.pem" "$name.key"
done

# The spawner plays homes that are added later, so it needs all other agents' certificates.
set -- spawner.pem spawner.key
for path in "$authority"/*.key; do
    name=$(basename "$path" .key)
    case $name in
        ca | clock | router | gateway | operator | spawner | grid | p1 | p2 | p3) ;;
        *) set -- "$@" "$name.pem" "$name.key" ;;
    esac
done
give spawner "$@"
