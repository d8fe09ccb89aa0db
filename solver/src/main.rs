fn main() {
    cd_formats::atomic::outlive_size_limit();
    std::process::exit(cd_solve::run(std::env::args_os()))
}
