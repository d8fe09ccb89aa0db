fn main() {
    std::process::exit(cd_pre::run(std::env::args_os()))
}
