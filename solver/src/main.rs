fn main() {
    std::process::exit(cd_solve::run(std::env::args_os()))
}
