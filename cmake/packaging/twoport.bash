# Completion of the twoport programs: options and commands as --help of the installed program lists them.

_twoport() {
  local program=$1 word=$2 before=$3 sub=''
  COMPREPLY=()
  if [ "${program##*/}" = twoport-lab ] || [ "${program##*/}" = twoport-device ]; then
    [ "$COMP_CWORD" -gt 1 ] && sub=${COMP_WORDS[1]}
  fi
  case $before in
    --device | --robot)
      mapfile -t COMPREPLY < <(compgen -W "$("$program" --list-devices 2>/dev/null | cut -f 1 | grep -v '^PATH')" -- "$word"; compgen -f -X '!*.so' -- "$word")
      return ;;
    probe)
      mapfile -t COMPREPLY < <(compgen -W "$("$program" list 2>/dev/null | cut -f 1 | grep -v '^PATH')" -- "$word"; compgen -f -X '!*.so' -- "$word")
      return ;;
    --methods)
      mapfile -t COMPREPLY < <(compgen -W "$("$program" methods 2>/dev/null | cut -f 1)" -- "$word")
      return ;;
    --scene)
      mapfile -t COMPREPLY < <(compgen -f -X '!*.textproto' -- "$word"; compgen -d -- "$word")
      return ;;
    --key | --out)
      mapfile -t COMPREPLY < <(compgen -f -- "$word")
      return ;;
  esac
  case $word in
    -*)
      mapfile -t COMPREPLY < <(compgen -W "$("$program" $sub --help 2>/dev/null | grep -oE '(^|[ ,])--[a-z][a-z-]*' | tr -d ' ,')" -- "$word") ;;
    *)
      if [ -z "$sub" ] && [ "$COMP_CWORD" -eq 1 ] && { [ "${program##*/}" = twoport-lab ] || [ "${program##*/}" = twoport-device ]; }; then
        mapfile -t COMPREPLY < <(compgen -W "$("$program" --help 2>/dev/null | sed -n '/^Subcommands:/,$ s/^  \([a-z][a-z-]*\) .*/\1/p')" -- "$word")
      else
        mapfile -t COMPREPLY < <(compgen -f -X '!*.textproto' -- "$word"; compgen -d -- "$word")
      fi ;;
  esac
}
complete -o filenames -F _twoport twoport-master twoport-slave twoport-lab twoport-device
complete -f twoport-keygen
